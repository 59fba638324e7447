// Upsampling, preparation: which squares of four coarse pixels lie on one surface, so that their sums may be interpolated.
#include "generated/constants.glsl"
#include "lib/same_surface.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;  // g-buffer, of all pixels
uniform sampler2D normal;
uniform sampler2D sums;      // Σ k·E, Σ k of the coarse pixels: every other one in x and y
uniform sampler2D weight;    // their Σw

layout(location = 0) out vec4 out_irradiance;  // E of the first of the four, and its Σw
layout(location = 1) out vec4 out_plane;       // the square's plane, dot(xyz, p) = w; (0, 0, 0, 0): not one surface; (0, 0, 0, 1): no record covers any of the four

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), last = textureSize(sums, 0) - 1;
    vec3 p = texel_at(position, 2 * at).xyz, n = texel_at(normal, 2 * at).xyz;
    vec4 sum = texel_at(sums, at);
    bool one = true, covered = sum.a > COVERED;
    for (int i = 1; i < 4; ++i)
    {
        ivec2 other = min(at + ivec2(i & 1, i >> 1), last);
        vec3 q = texel_at(position, 2 * other).xyz, m = texel_at(normal, 2 * other).xyz;
        one = one && (texel_at(sums, other).a > COVERED) == covered && (same_surface(p, n, q, m) || !covered);
    }
    out_irradiance = vec4(sum.rgb / max(sum.a, 1e-20), texel_at(weight, at).r);
    out_plane = !one ? vec4(0.0) : covered ? vec4(n, dot(n, p)) : vec4(0.0, 0.0, 0.0, 1.0);
}
