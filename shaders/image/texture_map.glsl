// Texture maps of a surface, at full resolution. ALBEDO_MAP, EMISSION_MAP, NORMAL_MAP: 1 if the surface has the map. …_from_uv:
// matrix from both sets of texture coordinates to image coordinates; …_place: xy offset, zw 1 if the image repeats mirrored along
// x or y.
#if ALBEDO_MAP
uniform sampler2D albedo_map;  // sRGB, with alpha
uniform mat4x2 albedo_from_uv;
uniform vec4 albedo_place;
#endif
#if EMISSION_MAP
uniform sampler2D emission_map;  // sRGB
uniform mat4x2 emission_from_uv;
uniform vec4 emission_place;
#endif
#if NORMAL_MAP
uniform sampler2D normal_map;
uniform mat4x2 normal_from_uv;
uniform vec4 normal_place;
uniform float normal_scale;  // factor on the map's x and y
#endif

// Return image coordinates, folded in mirrored directions, because moderngl cannot set OpenGL's mirrored repetition.
vec2 folded(vec2 st, vec2 mirrored)
{
    return mix(st, 1.0 - abs(1.0 - mod(st, 2.0)), mirrored);
}

// Return the mean over a pixel's footprint. A long footprint has up to MAP_TAPS samples along its length (1 with the driver's
// anisotropic filter). If it is also wider than a texel, it has two rows of samples, half a level finer, because one would blur
// beyond its sides.
vec4 map_texel(sampler2D map, vec2 st, vec2 mirrored)
{
    vec2 x = dFdx(st), y = dFdy(st);
#if MAP_TAPS > 1
    vec2 size = vec2(textureSize(map, 0));  // texels
    float across = length(x * size), down = length(y * size);
    vec2 along = across > down ? x : y;
    float taps = clamp(ceil(max(across, down) / max(min(across, down), 1.0) - 0.1), 1.0, float(MAP_TAPS));
    bool wide = taps > 1.0 && min(across, down) > 1.0;
    vec2 row = wide ? 0.25 * (across > down ? y : x) : vec2(0.0);
    float finer = wide ? 0.70710678 : 1.0;
    x *= finer / (across > down ? taps : 1.0);
    y *= finer / (across > down ? 1.0 : taps);
    vec4 sum = vec4(0.0);
    for (float tap = 0.5; tap < taps; ++tap)
    {
        vec2 at = st + (tap / taps - 0.5) * along;
        sum += textureGrad(map, folded(at - row, mirrored), x, y);
        if (wide) sum += textureGrad(map, folded(at + row, mirrored), x, y);
    }
    return sum / (wide ? 2.0 * taps : taps);
#else
    return textureGrad(map, folded(st, mirrored), x, y);
#endif
}

#if ALBEDO_MAP
// Return the mean colour and alpha over a pixel's footprint.
vec4 albedo_texel(vec4 uv)
{
    return map_texel(albedo_map, albedo_from_uv * uv + albedo_place.xy, albedo_place.zw);
}
#endif

#if NORMAL_MAP
// Return the unit normal n, modified by the normal map; n if the coordinates have no gradient. The tangents are the gradients of
// the map's coordinates on the surface, by screen-space derivatives (Schuler 2013, "Followup: Normal Mapping Without Precomputed
// Tangents"), so that mirrored coordinates need no sign. n, g: shading and geometric normal on the visible side; no result lies
// below the plane of g. front: true for the front; on the back, a bump is a dent.
vec3 mapped_normal(vec3 p, vec3 n, vec3 g, vec4 uv, bool front)
{
    vec2 st = normal_from_uv * uv + normal_place.xy;
    vec3 bent = map_texel(normal_map, st, normal_place.zw).xyz * 2.0 - 1.0;
    bent.xy *= front ? normal_scale : -normal_scale;
    vec2 st_x = dFdx(st), st_y = dFdy(st);
    vec3 across_y = cross(dFdy(p), n), across_x = cross(n, dFdx(p));
    vec3 tangent = across_y * st_x.x + across_x * st_y.x;
    vec3 bitangent = -(across_y * st_x.y + across_x * st_y.y);  // upward in the image
    float size = max(dot(tangent, tangent), dot(bitangent, bitangent));
    if (!(size > 0.0) || isinf(size)) return n;
    vec3 mapped = (tangent * bent.x + bitangent * bent.y) * inversesqrt(size) + n * max(bent.z, 0.0);
    mapped -= g * min(dot(mapped, g), 0.0);
    float length_2 = dot(mapped, mapped);
    return length_2 > 1e-12 ? mapped * inversesqrt(length_2) : n;
}
#endif
