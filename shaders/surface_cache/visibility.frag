// Whether two points see each other by way of a third: a fragment is a pair.
#include "lib/rays/bvh.glsl"

uniform sampler2D lines;  // three texels a pair: from where, by way of what, to where

layout(location = 0) out float out_seen;

void main()
{
    ivec2 first = ivec2(gl_FragCoord.xy) * ivec2(3, 1);
    vec3 a = texelFetch(lines, first, 0).xyz, between = texelFetch(lines, first + ivec2(1, 0), 0).xyz;
    vec3 b = texelFetch(lines, first + ivec2(2, 0), 0).xyz;
    // BEYOND, from visibility.py: the first part ends behind the point between, so that a surface on which that lies is in the way
    out_seen = bvh_free(a, mix(a, between, BEYOND)) && bvh_free(between, b) ? 1.0 : 0.0;
}
