// Clears the splat buffer: sums of 0, and the weight NOTHING_SEEN without a surface or in an unlit view (METHOD.md, 7.1).
#include "generated/constants.glsl"
#include "indirect/splat_depth.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;  // g-buffer
uniform int pixel_stride;    // pixels of the g-buffer per pixel of the sums, in x and y
uniform bool unlit;          // true if the camera lies in a closed mesh without a light

layout(location = 0) out vec4 out_sums;    // see splat.frag
layout(location = 1) out vec2 out_weight;

void main()
{
    out_sums = vec4(0.0);
    float depth = unlit ? 0.0 : texel_at(position, pixel_stride * ivec2(gl_FragCoord.xy)).w;
    out_weight = vec2(depth > 0.0 ? 0.0 : NOTHING_SEEN, 0.0);
    gl_FragDepth = depth > 0.0 ? splat_depth(depth) : 0.0;
}
