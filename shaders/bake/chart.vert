// Triangles where they lie in a second set of texture coordinates, without attributes: three vertices each.
#include "lib/table.glsl"

uniform sampler2D corners;  // of triangle i, three texels: xy in texels of the lightmap
uniform vec2 offset;        // from a texel's centre to its sample point, texels
uniform vec2 texels;        // width and height of the lightmap

flat out int v_triangle;
out vec2 v_share;           // of the second and the third corner

void main()
{
    int part = gl_VertexID % 3;
    v_triangle = gl_VertexID / 3;
    v_share = vec2(part == 1, part == 2);
    vec2 at = texelFetch(corners, table_texel(v_triangle, 3, part), 0).xy - offset;
    gl_Position = vec4(2.0 * at / texels - 1.0, 0.0, 1.0);
}
