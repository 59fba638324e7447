// The material at a point of a surface, from the table of materials and the interpolated vertex (METHOD.md, 3.9).
// TEXTURES: 1 in light passes if the scene has textures.
#include "generated/constants.glsl"
#include "generated/vertex.glsl"
#include "lib/material.glsl"
#include "lib/texel.glsl"

uniform sampler2D material_table;  // per material one column of MATERIAL_ROWS texels, TABLE_COLUMNS columns side by side

// Return a row of a material in the table; MaterialRow in irrsplat/core/buffers.py lists the rows.
vec4 material_row(int material, int row)
{
    return texel_at(material_table, ivec2(material & (TABLE_COLUMNS - 1), (material >> TABLE_SHIFT) * MATERIAL_ROWS + row));
}

// Return the material without its textures.
Material material_factors(Vertex point)
{
    vec3 emission = material_row(int(point.material), MATERIAL_EMISSION).rgb;
    if (point.albedo.r < -0.5) return Material(vec3(0.0), emission * max(-1.0 - point.albedo, 0.0));  // an unlit material
    return Material(point.albedo, emission);
}

#if TEXTURES
uniform sampler2DArray texture_layers;  // rgb: linear colour times alpha; a: alpha

// Return a texture coordinate after wrapping; wrap: its number in MaterialRow (0: repeat). margin: half a texel of the
// coarser of the two sampled levels, so that clamped and mirrored textures do not blend with the opposite edge.
float wrapped(float x, int wrap, float margin)
{
    if (wrap == 1) x = 1.0 - abs(mod(x, 2.0) - 1.0);
    return wrap == 0 ? x : clamp(x, margin, 1.0 - margin);
}

// Return the coordinates, 0..1, of a point in a texture layer. across, down: the first two rows of the texture in the table.
vec2 texture_coordinates(Vertex point, vec4 across, vec4 down, float margin)
{
    int code = int(down.w), wrap = code % 9;
    vec3 uv = vec3(code >= 9 ? point.uv.zw : point.uv.xy, 1.0);
    return vec2(wrapped(dot(across.xyz, uv), wrap % 3, margin), wrapped(dot(down.xyz, uv), wrap / 3, margin));
}

// Return the mean of a texture over a footprint: colour times alpha, and alpha. row: the first row of the texture in the table.
// uv_area: area of the footprint in both sets of texture coordinates. The texels of the sampled level are as large as the
// footprint (Williams 1983).
vec4 texture_mean(Vertex point, int row, vec2 uv_area)
{
    int material = int(point.material);
    vec4 across = material_row(material, row), down = material_row(material, row + 1);
    float side = float(textureSize(texture_layers, 0).x);
    float texels = (down.w > 8.5 ? uv_area.y : uv_area.x) * abs(across.x * down.y - across.y * down.x) * side * side;
    float level = 0.5 * log2(clamp(texels, 1.0, side * side)), margin = 0.5 * exp2(ceil(level)) / side;
    vec4 mean = textureLod(texture_layers, vec3(texture_coordinates(point, across, down, margin), max(across.w, 0.0)), level);
    return across.w < 0.0 ? material_row(material, row + 2) : mean;
}
#endif

// Return the area that `area` m² of the triangle a, b, c cover in both sets of texture coordinates. The whole triangle is the
// limit, because neighbouring texels of the image may belong to another surface.
vec2 texture_area(float area, Vertex a, Vertex b, Vertex c)
{
    vec4 u = b.uv - a.uv, v = c.uv - a.uv;
    float twice_area = length(cross(b.position - a.position, c.position - a.position));
    return abs(vec2(u.x * v.y - u.y * v.x, u.z * v.w - u.w * v.z)) * min(area / max(twice_area, 1e-30), 0.5);
}

// Return the mean of the material over a footprint. uv_area: its area in both sets of texture coordinates.
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
