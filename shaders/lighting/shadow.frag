// The depth buffer is the shadow map: nothing to write. With CUT_OUTS, of surfaces that are not there everywhere.
#if CUT_OUTS
#include "generated/interpolated.glsl"
#include "lib/cut_outs.glsl"
#endif

void main()
{
#if CUT_OUTS
    if (light_passes(interpolated_vertex(vec3(0.0)))) discard;
#endif
}
