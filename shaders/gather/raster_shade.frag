// The same as raster.frag where it is known which triangle each texel sees: one that many hide behind is lit alone.
#include "gather/raster_texel.glsl"

uniform sampler2D seen;            // the triangle that each texel of the atlas sees, as raster_triangle.frag has it
uniform sampler2D triangle_table;  // a texel a triangle, in rows of TABLE_COLUMNS: its corners' numbers, and its own in the scene
uniform sampler2D vertex_table;    // three texels a vertex, in rows of TABLE_COLUMNS of them: position, normal, albedo, emission

mat3x4 vertex(float number)
{
    int i = int(number);
    ivec2 at = table_texel(i, 3, 0);
    return mat3x4(texelFetch(vertex_table, at, 0), texelFetch(vertex_table, at + ivec2(1, 0), 0),
                  texelFetch(vertex_table, at + ivec2(2, 0), 0));
}

void main()
{
    int number = int(texelFetch(seen, ivec2(gl_FragCoord.xy), 0).r) - 1, i = max(number, 0);
    vec4 triangle = texelFetch(triangle_table, table_texel(i), 0);
    vec3 q = texel_ray();

    // The ray's coordinates among the corners, by the volumes that it spans with the edges; at the edge where the rasteriser
    // has shifted the triangle a little, and the ray passes beside it.
    mat3x4 A = vertex(triangle.x), B = vertex(triangle.y), C = vertex(triangle.z);
    vec3 a = A[0].xyz - v_eye, b = B[0].xyz - v_eye, c = C[0].xyz - v_eye;
    vec3 share = vec3(dot(q, cross(c - b, c + b)), dot(q, cross(a - c, a + c)), dot(q, cross(b - a, b + a)));
    share = max(share.x + share.y + share.z < 0.0 ? -share : share, 1e-30);
    share /= share.x + share.y + share.z;
    mat3x4 look = share.x * A + share.y * B + share.z * C;
    see(int(triangle.w), q, vec3(look[0].w, look[1].xy), vec3(look[1].zw, look[2].x), look[2].yzw);
    if (number < 0) out_radiance = out_plane = vec4(0.0);
}
