// The visible share of a segment, from its start to the first hit (METHOD.md, 11.2). A fragment is a segment.
#include "lib/rays/bvh.glsl"

uniform sampler2D lines;  // two texels per segment: start and end, world space, metres

layout(location = 0) out float out_share;

void main()
{
    ivec2 first = ivec2(gl_FragCoord.xy) * ivec2(2, 1);
    vec3 start = texelFetch(lines, first, 0).xyz, segment = texelFetch(lines, first + ivec2(1, 0), 0).xyz - start;
    float distance = length(segment);
    out_share = distance == 0.0 ? 1.0 : bvh_between(start, segment / distance, 0.0, distance).t / distance;
}
