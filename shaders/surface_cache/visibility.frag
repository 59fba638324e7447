// The visible share of a segment between two points: a fragment is a segment.
#include "lib/rays/bvh.glsl"

uniform sampler2D lines;  // two texels a segment: from where, and to where

layout(location = 0) out float out_share;

void main()
{
    ivec2 first = ivec2(gl_FragCoord.xy) * ivec2(2, 1);
    vec3 start = texelFetch(lines, first, 0).xyz, away = texelFetch(lines, first + ivec2(1, 0), 0).xyz - start;
    float far = length(away);
    out_share = far == 0.0 ? 1.0 : bvh_between(start, away / far, 0.0, far).t / far;
}
