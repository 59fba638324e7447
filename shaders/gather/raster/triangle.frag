// Which triangle is seen: its place in the order of the meshlets, counted from 1, so that 0 is none. With CUT_OUTS, of a meshlet whose
// triangles are not there everywhere.
#if CUT_OUTS
#include "generated/interpolated.glsl"
#include "lib/rays/cut_outs.glsl"
#endif

uniform ivec2 piece;  // the meshlet's first pair, and its first triangle

layout(location = 0) out float out_triangle;

void main()
{
#if CUT_OUTS
    if (light_passes(interpolated_vertex(vec3(0.0)))) discard;
#endif
    out_triangle = float(piece.y + gl_PrimitiveID + 1);
}
