// The depth of a shadow tile: distance along the tile's axis. Linear depth has equal precision at all distances. CUT_OUTS: 1 for
// surfaces with holes.
#if CUT_OUTS
#include "generated/interpolated.glsl"
#include "lib/rays/cut_outs.glsl"
#endif

uniform float tile_near;  // see shadow.vert
uniform float tile_far;   // depth of a perspective tile, metres

void main()
{
#if CUT_OUTS
    if (light_passes(interpolated_vertex(vec3(0.0)))) discard;
#endif
    gl_FragDepth = tile_near > 0.0 ? 1.0 / (gl_FragCoord.w * tile_far) : gl_FragCoord.z;
}
