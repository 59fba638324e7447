// An empty splat buffer: sums of 0, and the weight NOTHING_SEEN where the camera sees nothing.
#include "generated/constants.glsl"

uniform sampler2D position;  // g-buffer
uniform int pixel_stride;    // pixels of the g-buffer per pixel of the sums, in x and y

layout(location = 0) out vec4 out_sums;
layout(location = 1) out vec2 out_weight;

void main()
{
    out_sums = vec4(0.0);
    out_weight = vec2(texelFetch(position, pixel_stride * ivec2(gl_FragCoord.xy), 0).w > 0.0 ? 0.0 : NOTHING_SEEN, 0.0);
}
