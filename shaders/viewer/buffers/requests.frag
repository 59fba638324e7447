// In orange, the pixels that request a record, over the dimmed grey picture.
#include "viewer/buffers/picture.glsl"
#include "indirect/effective_weight.glsl"

uniform sampler2D image;
uniform sampler2D sums;
uniform float gain;  // the exposure as a factor

vec3 picture(ivec2 pixel, float depth)
{
    if (effective_weight(texelFetch(values, pixel, 0).rg, texelFetch(sums, pixel, 0), 1.0) < tolerance) return vec3(1.0, 0.45, 0.05);
    return vec3(0.45 * dot(display(texelFetch(image, pixel, 0).rgb * gain), LUMINANCE));
}
