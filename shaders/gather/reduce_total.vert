// A point for each record of the batch, on its own texel of the cache.
#include "gather/places.glsl"
#include "lib/table.glsl"

uniform sampler2D frames;  // texel (i, 3), w: number in the cache of the record of eye i
uniform ivec2 table;       // columns and rows of the cache

flat out int v_index;

void main()
{
    v_index = gl_VertexID;
    int number = int(texelFetch(frames, ivec2(gl_VertexID * places, 3), 0).w);
    gl_Position = table_point(number, table);
}
