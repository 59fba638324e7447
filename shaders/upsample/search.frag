// Upsampling, second draw: the marked pixels.
#include "generated/constants.glsl"
#include "upsample/search.glsl"

uniform sampler2D weight;  // of the coarse pixels

layout(location = 0) out vec4 out_sums;    // E and 1
layout(location = 1) out vec2 out_weight;  // Σw of a coarse pixel, and Y²

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_sums = searched(pixel);
    float Y = dot(out_sums.rgb, LUMINANCE);
    out_weight = vec2(texel_at(weight, pixel / 2).r, Y * Y);
}
