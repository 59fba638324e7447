// The material at a point of a surface: by the table of materials and the vertices. Light passes define TEXTURES, which is 1 if the
// scene has textures.
#include "generated/constants.glsl"
#include "generated/material.glsl"
#include "generated/vertex.glsl"
#include "lib/texel.glsl"

uniform sampler2D material_table;  // a column a material, TABLE_COLUMNS of them side by side, MATERIAL_ROWS texels high

vec4 material_row(int material, int row)
{
    return texel_at(material_table, ivec2(material & (TABLE_COLUMNS - 1), (material >> TABLE_SHIFT) * MATERIAL_ROWS + row));
}

// The material without its textures.
Material material_factors(Vertex point)
{
    vec3 emission = material_row(int(point.material), MATERIAL_EMISSION).rgb;
    if (point.albedo.r < -0.5) return Material(vec3(0.0), emission * max(-1.0 - point.albedo, 0.0));  // unlit, of colours of its own
    return Material(point.albedo, emission);
}

#if TEXTURES
uniform sampler2DArray texture_layers;  // colours times alpha, and alpha

// A coordinate of a layer by its number among WRAPS (0: it repeats); margin: half a texel of the coarser
// sampled level.
float wrapped(float x, int wrap, float margin)
{
    if (wrap == 1) x = 1.0 - abs(mod(x, 2.0) - 1.0);
    return wrap == 0 ? x : clamp(x, margin, 1.0 - margin);
}

// Where a point is in a texture, 0..1 in either direction, or beyond where that repeats. across, down: the texture's rows.
vec2 texture_place(Vertex point, vec4 across, vec4 down, float margin)
{
    int code = int(down.w), wrap = code % 9;
    vec3 uv = vec3(code >= 9 ? point.uv.zw : point.uv.xy, 1.0);
    return vec2(wrapped(dot(across.xyz, uv), wrap % 3, margin), wrapped(dot(down.xyz, uv), wrap / 3, margin));
}

// The mean over a footprint of a texture whose rows in the table begin with `row`: colour times alpha, and alpha.
// uv_area: of the footprint, in both sets of texture coordinates; the level is that whose texels are as large (Williams 1983).
vec4 texture_mean(Vertex point, int row, vec2 uv_area)
{
    int material = int(point.material);
    vec4 across = material_row(material, row), down = material_row(material, row + 1);
    float side = float(textureSize(texture_layers, 0).x);
    float texels = (down.w > 8.5 ? uv_area.y : uv_area.x) * abs(across.x * down.y - across.y * down.x) * side * side;
    float level = 0.5 * log2(clamp(texels, 1.0, side * side)), margin = 0.5 * exp2(ceil(level)) / side;
    vec4 found = textureLod(texture_layers, vec3(texture_place(point, across, down, margin), max(across.w, 0.0)), level);
    return across.w < 0.0 ? material_row(material, row + 2) : found;
}
#endif

// The area in both sets of texture coordinates of `area` m² of the triangle with these corners, or of all of it if that is less:
// texels next to it in the image may belong to another surface.
vec2 texture_area(float area, Vertex a, Vertex b, Vertex c)
{
    vec4 u = b.uv - a.uv, v = c.uv - a.uv;
    float whole = length(cross(b.position - a.position, c.position - a.position));
    return abs(vec2(u.x * v.y - u.y * v.x, u.z * v.w - u.w * v.z)) * min(area / max(whole, 1e-30), 0.5);
}

// The mean of the material over a footprint of that area.
Material material_mean(Vertex point, vec2 uv_area)
{
    Material material = material_factors(point);
#if TEXTURES
    vec4 albedo = texture_mean(point, MATERIAL_ALBEDO_TEXTURE, uv_area);
    material.albedo *= albedo.rgb / max(albedo.a, 1e-3);
    material.emission *= texture_mean(point, MATERIAL_EMISSION_TEXTURE, uv_area).rgb;
#endif
    return material;
}
