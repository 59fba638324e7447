// The triangles that rays of light can hit, by their numbers in the scene (irrsplat/gpu/bvh_table.py).
#include "lib/table.glsl"

uniform sampler2D triangle_corners; // three texels per triangle, TABLE_COLUMNS triangles per row: xyz a corner, metres; w the number i
                                    // of its vertex, in the first texel of a cut-out triangle -1 - i

// Return a corner, 0..2, of a triangle: position, and vertex number as above.
vec4 triangle_corner(int triangle, int corner)
{
    return texel_at(triangle_corners, table_texel(triangle, 3, corner));
}

// Return the position of a corner, world space, metres.
vec3 triangle_point(int triangle, int corner)
{
    return triangle_corner(triangle, corner).xyz;
}

// Return the numbers of the vertices of a triangle.
ivec3 triangle_vertices(int triangle)
{
    ivec3 numbers = ivec3(triangle_corner(triangle, 0).w, triangle_corner(triangle, 1).w, triangle_corner(triangle, 2).w);
#if CUT_OUTS
    if (numbers.x < 0) numbers.x = -1 - numbers.x;
#endif
    return numbers;
}
