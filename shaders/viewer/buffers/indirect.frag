// Indirect radiance: a mean over samples, or albedo/pi times the irradiance of the sums.
#include "viewer/buffers/picture.glsl"

uniform sampler2D albedo;  // g-buffer
uniform float gain;        // the exposure as a factor
uniform bool averaged;     // true if `values` is the mean radiance over a pixel's samples

vec3 picture(ivec2 pixel, float depth)
{
    vec4 s = texelFetch(values, pixel, 0);
    if (averaged) return display(s.rgb * gain);
    return s.a > 0.0 ? display(texelFetch(albedo, pixel, 0).rgb * (s.rgb / s.a * INV_PI * gain)) : vec3(0.0);
}
