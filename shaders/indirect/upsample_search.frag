// Upsampling, last of three draws (METHOD.md, 8.1): a marked pixel takes the mean of those of the 16 surrounding coarse pixels
// that lie on its surface (joint bilateral upsampling, Kopf et al. 2007).
#include "lib/same_surface.glsl"
#include "lib/texel.glsl"
#include "generated/constants.glsl"

uniform sampler2D position;  // g-buffer, all pixels
uniform sampler2D normal;
uniform sampler2D sums;      // Σ k·E, Σ k of the coarse pixels
uniform sampler2D weight;    // Σw of the coarse pixels

layout(location = 0) out vec4 out_sums;    // E and 1
layout(location = 1) out vec2 out_weight;  // Σw of the nearest coarse pixel, and Y²: no inter-record variance

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy), first = pixel / 2, last = textureSize(sums, 0) - 1;
    vec3 p = texel_at(position, pixel).xyz, n = texel_at(normal, pixel).xyz;
    vec2 offset = 0.5 * vec2(pixel - 2 * first);
    out_sums = vec4(0.0);
    for (int i = 0; i < 16; ++i)
    {
        ivec2 off = ivec2(i & 3, i >> 2) - 1, at = clamp(first + off, ivec2(0), last);
        vec3 q = texel_at(position, 2 * at).xyz, m = texel_at(normal, 2 * at).xyz;
        vec4 sum = texel_at(sums, at);
        float share = bilateral_weight(p, n, q, m, distance(vec2(off), offset));
        out_sums += sum.a > COVERED ? share * vec4(sum.rgb / sum.a, 1.0) : vec4(0.0);
    }
    out_sums = out_sums.a > 0.0 ? out_sums / out_sums.a : vec4(0.0);
    float Y = dot(out_sums.rgb, LUMINANCE);
    out_weight = vec2(texel_at(weight, first).r, Y * Y);
}
