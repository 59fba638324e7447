// Whether two points see each other by way of a third: a fragment is a pair.
#include "lib/bvh.glsl"

uniform sampler2D ways;  // three texels a pair: from where, by what, to where

layout(location = 0) out float out_seen;

void main()
{
    ivec2 first = ivec2(gl_FragCoord.xy) * ivec2(3, 1);
    vec3 a = texelFetch(ways, first, 0).xyz, between = texelFetch(ways, first + ivec2(1, 0), 0).xyz;
    vec3 b = texelFetch(ways, first + ivec2(2, 0), 0).xyz;
    // the first part goes a little too far: what the point between lies in stands in the way, too
    out_seen = bvh_free(a, mix(a, between, 1.001)) && bvh_free(between, b) ? 1.0 : 0.0;
}
