// Upsampling, first of three draws (METHOD.md, 8.1): a fragment tests if a square of four coarse pixels lies on one surface.
// Only then may sums be interpolated. Coarse pixels are every other pixel in x and y.
#include "generated/constants.glsl"
#include "lib/same_surface.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;  // g-buffer, all pixels
uniform sampler2D normal;
uniform sampler2D sums;      // Σ k·E, Σ k of the coarse pixels
uniform sampler2D weight;    // Σw of the coarse pixels

layout(location = 0) out vec4 out_irradiance;  // E and Σw of the first pixel
layout(location = 1) out vec4 out_plane;       // plane, dot(xyz, p) = w; 0 0 0 0: several surfaces; 0 0 0 1: no record

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), last = textureSize(sums, 0) - 1;
    vec3 p = texel_at(position, 2 * at).xyz, n = texel_at(normal, 2 * at).xyz;
    vec4 sum = texel_at(sums, at);
    bool one_surface = true, covered = sum.a > COVERED;
    for (int i = 1; i < 4; ++i)
    {
        ivec2 neighbour = min(at + ivec2(i & 1, i >> 1), last);
        vec3 q = texel_at(position, 2 * neighbour).xyz, m = texel_at(normal, 2 * neighbour).xyz;
        one_surface = one_surface && (texel_at(sums, neighbour).a > COVERED) == covered && (same_surface(p, n, q, m) || !covered);
    }
    out_irradiance = vec4(sum.rgb / max(sum.a, 1e-20), texel_at(weight, at).r);
    out_plane = !one_surface ? vec4(0.0) : covered ? vec4(n, dot(n, p)) : vec4(0.0, 0.0, 0.0, 1.0);
}
