// An empty splat buffer: sums of 0, and the weight NOTHING_SEEN where the camera sees nothing.
#include "generated/constants.glsl"
#include "indirect/splat_depth.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;  // g-buffer
uniform int pixel_stride;    // pixels of the g-buffer per pixel of the sums, in x and y

layout(location = 0) out vec4 out_sums;
layout(location = 1) out vec2 out_weight;

void main()
{
    out_sums = vec4(0.0);
    float depth = texel_at(position, pixel_stride * ivec2(gl_FragCoord.xy)).w;
    out_weight = vec2(depth > 0.0 ? 0.0 : NOTHING_SEEN, 0.0);
    gl_FragDepth = depth > 0.0 ? splat_depth(depth) : 0.0;
}
