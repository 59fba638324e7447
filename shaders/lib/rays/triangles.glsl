// The triangles that light sees, by their numbers in the scene (irrsplat/gpu/bvh_table.py).
#include "lib/table.glsl"

uniform sampler2D triangle_corners; // three texels a triangle, in rows of TABLE_COLUMNS of them: a corner, its vertex's number; the
                                    // first one is -1 - that where the triangle is cut out

vec4 triangle_corner(int triangle, int corner)
{
    return texel_at(triangle_corners, table_texel(triangle, 3, corner));
}

vec3 triangle_point(int triangle, int corner)
{
    return triangle_corner(triangle, corner).xyz;
}

// The numbers of its vertices.
ivec3 triangle_vertices(int triangle)
{
    ivec3 numbers = ivec3(triangle_corner(triangle, 0).w, triangle_corner(triangle, 1).w, triangle_corner(triangle, 2).w);
#if CUT_OUTS
    if (numbers.x < 0) numbers.x = -1 - numbers.x;
#endif
    return numbers;
}
