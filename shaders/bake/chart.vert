// Baking: draws triangles at their second texture coordinates, three vertices each, without attributes.
#include "lib/table.glsl"

uniform sampler2D corners;  // three texels per triangle: xy in texels of the lightmap
uniform vec2 offset;        // from a texel's centre to its sample point, texels
uniform vec2 texels;        // width and height of the lightmap

flat out int v_triangle;
out vec2 v_barycentric;           // barycentric coordinates of the second and third corner

void main()
{
    int part = gl_VertexID % 3;
    v_triangle = gl_VertexID / 3;
    v_barycentric = vec2(part == 1, part == 2);
    vec2 at = texelFetch(corners, table_texel(v_triangle, 3, part), 0).xy - offset;
    gl_Position = vec4(2.0 * at / texels - 1.0, 0.0, 1.0);
}
