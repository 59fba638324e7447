// All of the irradiance: what records say of a pixel, and what was sampled there of emitters.
#include "image/neighbouring_sums.glsl"

uniform sampler2D position;    // g-buffer
uniform sampler2D emitters;    // irradiance, W/m²

layout(location = 0) out vec4 out_sums;  // E, 1

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_sums = vec4(0.0);
    if (texelFetch(position, pixel, 0).w == 0.0) return;
    vec4 s = own_or_neighbouring_sums(pixel);
    vec3 E = s.a > 0.0 ? s.rgb / s.a : vec3(0.0);
    out_sums = vec4(E + texelFetch(emitters, pixel, 0).rgb, 1.0);
}
