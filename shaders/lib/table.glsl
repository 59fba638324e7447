// Tables in textures, by item number: item i is in row i / TABLE_COLUMNS, and a row has TABLE_COLUMNS items.
#include "generated/constants.glsl"
#include "lib/texel.glsl"

// Return the texel of item i.
ivec2 table_texel(int i)
{
    return ivec2(i & (TABLE_COLUMNS - 1), i >> TABLE_SHIFT);
}

// Return texel `part` of item i in a table of `parts` texels per item.
ivec2 table_texel(int i, int parts, int part)
{
    return ivec2(parts * (i & (TABLE_COLUMNS - 1)) + part, i >> TABLE_SHIFT);
}

// Return the clip space position of a point that covers texel (i % size.x, i / size.x) of a target of `size` columns and rows.
vec4 table_point(int i, ivec2 size)
{
    vec2 texel = vec2(i % size.x, i / size.x) + 0.5;
    return vec4(texel / vec2(size) * 2.0 - 1.0, 0.0, 1.0);
}
