// Upsampling, first draw: pixels between four coarse ones of one surface. The other pixels are marked in the depth buffer, for
// search.frag.
#include "generated/constants.glsl"
#include "upsample/between.glsl"

uniform sampler2D position;  // g-buffer, of all pixels

layout(location = 0) out vec4 out_sums;    // E and 1
layout(location = 1) out vec2 out_weight;  // Σw, and Y²: how far records contradict each other is not kept

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(position, at);
    bool between, none;
    vec4 E = between_four(at, p, between, none);
    float Y = dot(E.rgb, LUMINANCE);
    out_sums = vec4(E.rgb, between ? 1.0 : 0.0);
    out_weight = p.w == 0.0 ? vec2(NOTHING_SEEN, 0.0) : vec2(E.a, Y * Y);
    gl_FragDepth = between || none || p.w == 0.0 ? 0.0 : 1.0;
}
