// Last step of the reduction: a point per record of the batch, at the record's texel in the cache.
#include "gather/places.glsl"
#include "lib/table.glsl"

uniform sampler2D frames;  // w of texel (i, 3): number in the cache of the record with eye i
uniform ivec2 table;       // columns and rows of the cache's textures

flat out int v_index;      // index of the record in the batch

void main()
{
    v_index = gl_VertexID;
    int number = int(texelFetch(frames, ivec2(gl_VertexID * places, 3), 0).w);
    gl_Position = table_point(number, table);
}
