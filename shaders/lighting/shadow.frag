// The depth buffer is the shadow map: the distance along the tile's axis, linear, so that it is as fine far away as near by. With
// CUT_OUTS, of surfaces that are not there everywhere.
#if CUT_OUTS
#include "generated/interpolated.glsl"
#include "lib/rays/cut_outs.glsl"
#endif

uniform float tile_near;  // as in shadow.vert
uniform float tile_far;   // metres of depth in a perspective tile

void main()
{
#if CUT_OUTS
    if (light_passes(interpolated_vertex(vec3(0.0)))) discard;
#endif
    gl_FragDepth = tile_near > 0.0 ? 1.0 / (gl_FragCoord.w * tile_far) : gl_FragCoord.z;
}
