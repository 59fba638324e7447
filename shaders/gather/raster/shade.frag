// The same as draw.frag where it is known which triangle each texel sees: one that many hide behind is lit alone.
#include "gather/raster/texel.glsl"
#include "generated/vertex_table.glsl"

uniform sampler2D seen;            // the triangle that each texel of the atlas sees, as triangle.frag has it
uniform sampler2D triangle_table;  // a texel a triangle, in rows of TABLE_COLUMNS: its corners' numbers, and its own in the scene

void main()
{
    int number = int(texelFetch(seen, ivec2(gl_FragCoord.xy), 0).r) - 1, i = max(number, 0);
    vec4 triangle = texelFetch(triangle_table, table_texel(i), 0);
    vec3 q = texel_ray();

    // The ray's coordinates among the corners, by the volumes that it spans with the edges; at the edge where the rasteriser
    // has shifted the triangle a little, and the ray passes beside it.
    Vertex A = vertex_at(int(triangle.x)), B = vertex_at(int(triangle.y)), C = vertex_at(int(triangle.z));
    vec3 a = A.position - v_eye, b = B.position - v_eye, c = C.position - v_eye;
    vec3 share = vec3(dot(q, cross(c - b, c + b)), dot(q, cross(a - c, a + c)), dot(q, cross(b - a, b + a)));
    share = max(share.x + share.y + share.z < 0.0 ? -share : share, 1e-30);
    share /= share.x + share.y + share.z;
    Met met = meet(int(triangle.w), q);
    Vertex point = interpolate(share, A, B, C);
#if TEXTURES
    Material material = material_mean(point, texture_area(footprint_area, A, B, C));
#else
    Material material = material_of(point);
#endif
    see(int(triangle.w), met, point, material);
    if (number < 0) out_radiance = out_plane = vec4(0.0);
}
