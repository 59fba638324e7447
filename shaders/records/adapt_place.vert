// A point for each limit that has been found, on its record's own texel of the cache.
uniform sampler2D targets;  // the records' numbers, row by row
uniform sampler2D limits;   // in the same places
uniform ivec2 table;        // columns and rows of the cache

flat out float v_limit;

void main()
{
    int columns = textureSize(targets, 0).x;
    ivec2 here = ivec2(gl_VertexID % columns, gl_VertexID / columns);
    int number = int(texelFetch(targets, here, 0).r);
    v_limit = texelFetch(limits, here, 0).r;
    vec2 texel = vec2(number % table.x, number / table.x) + 0.5;
    gl_Position = vec4(texel / vec2(table) * 2.0 - 1.0, 0.0, 1.0);
}
