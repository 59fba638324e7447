// Fills holes without a surface cache (METHOD.md, 8.2): pixels without a record take the irradiance of surrounding pixels.
#include "generated/constants.glsl"
#include "lighting/sky.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform sampler2D direct;    // direct radiance, with mipmaps
uniform sampler2D sums;      // Σ k·E, Σ k, with mipmaps
uniform int levels;          // coarsest level of the mipmaps

layout(location = 0) out vec4 out_sums;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_sums = texelFetch(sums, pixel, 0);
    if (texelFetch(position, pixel, 0).w == 0.0) return;
    vec2 uv = gl_FragCoord.xy / vec2(textureSize(sums, 0));
    // every other mipmap level, weighted 2^(-4·level): the finest level with records dominates, and Σ k makes transitions smooth
    int last = out_sums.a > 0.0 ? 0 : levels;
    for (int level = 1; level < last; level += 2) out_sums += textureLod(sums, uv, float(level)) * exp2(-4.0 * float(level));
    if (last == 0) return;
    // before the first record: half of the sky, and the mean direct radiance of the view from all directions
#if SKY_MAP
    vec3 guess = 0.5 * sky_irradiance(texelFetch(normal, pixel, 0).xyz) + PI * textureLod(direct, uv, float(levels)).rgb;
#else
    float rise = dot(texelFetch(normal, pixel, 0).xyz, sky_up);
    vec3 guess = PI * (0.5 * (sky + sky_gradient * (2.0 / 3.0) * rise) + textureLod(direct, uv, float(levels)).rgb);
#endif
    out_sums += vec4(guess, 1.0) * exp2(-4.0 * float(levels + 2));
}
