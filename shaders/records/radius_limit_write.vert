// A point for each limit that was found, on the texel of its record in the cache.
#include "lib/table.glsl"

uniform sampler2D targets;  // the records' numbers, row by row
uniform sampler2D limits;   // of the record in the same texel of `targets`
uniform ivec2 table;        // columns and rows of the cache

flat out float v_limit;

void main()
{
    int columns = textureSize(targets, 0).x;
    ivec2 here = ivec2(gl_VertexID % columns, gl_VertexID / columns);
    v_limit = texelFetch(limits, here, 0).r;
    gl_Position = table_point(int(texelFetch(targets, here, 0).r), table);
}
