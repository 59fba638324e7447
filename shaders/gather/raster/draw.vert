// The scene as many records see it at once: an instance is one face of one record, drawn into its own cell of an atlas. Where MESHLETS
// triangles are drawn, it is one meshlet in such a face, and it is only marked which triangle is seen.
#include "gather/raster/views.glsl"
#include "lib/table.glsl"

in vec3 in_position;
#if MESHLETS
uniform sampler2D pairs;  // in rows of TABLE_COLUMNS: which record, and which face of it, an instance is for
uniform ivec2 piece;      // the meshlet's first pair, and its first triangle
#else
uniform int faces;        // of a record
#endif
#if CUT_OUTS || !MESHLETS
#include "generated/attributes.glsl"
#endif

uniform vec2 atlas;  // texels
uniform float near;  // metres

out float gl_ClipDistance[5];

void main()
{
#if MESHLETS
    int pair = piece.x + gl_InstanceID;
    ivec2 at = ivec2(texelFetch(pairs, table_texel(pair), 0).xy);
#else
    ivec2 at = ivec2(gl_InstanceID / faces, gl_InstanceID % faces);
    view_of_texels(at);
#endif
#if CUT_OUTS || !MESHLETS
    pass_attributes();
#endif
    vec4 p = vec4(in_position, 1.0);
    float x = dot(view_row(at, VIEW_X), p), y = dot(view_row(at, VIEW_Y), p), w = dot(view_row(at, VIEW_W), p);
    // the four sides of the face, and its tip; there is no near plane beyond that (depth clamp), and no far one
    gl_ClipDistance[0] = w - x;
    gl_ClipDistance[1] = w + x;
    gl_ClipDistance[2] = w - y;
    gl_ClipDistance[3] = w + y;
    gl_ClipDistance[4] = w - 0.05 * near;
    vec4 cell = view_row(at, VIEW_CELL) * 2.0 / atlas.xyxy;
    gl_Position = vec4((cell.xy - 1.0) * w + cell.zw * vec2(x, y), w - 2.0 * near, w);
}
