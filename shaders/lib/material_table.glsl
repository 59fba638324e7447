// The material at a point of a surface: by the table of materials, and what the point's vertices have of it.
#include "generated/constants.glsl"
#include "generated/material.glsl"
#include "generated/vertex.glsl"

uniform sampler2D material_table;  // a column a material, TABLE_COLUMNS of them side by side, MATERIAL_ROWS texels high

vec4 material_row(int material, int row)
{
    return texelFetch(material_table, ivec2(material & (TABLE_COLUMNS - 1), (material >> TABLE_SHIFT) * MATERIAL_ROWS + row), 0);
}

// The material without its textures.
Material material_factors(Vertex point)
{
    return Material(point.albedo, material_row(int(point.material), MATERIAL_EMISSION).rgb);
}

Material material_of(Vertex point)
{
    return material_factors(point);
}
