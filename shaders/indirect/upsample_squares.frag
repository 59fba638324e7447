// Which squares of four neighbours lie on one surface, so that what is between them is between their sums.
#include "lib/alike.glsl"

uniform sampler2D position;  // g-buffer, of all pixels
uniform sampler2D normal;
uniform sampler2D sums;      // Σ k·E, Σ k of every other one
uniform sampler2D weight;    // their Σw

layout(location = 0) out vec4 out_irradiance;  // E of the first of the four, and its Σw
layout(location = 1) out vec4 out_plane;       // of the surface there: dot(xyz, p) is w; 0: not one, and w 1: none is served

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), last = textureSize(sums, 0) - 1;
    vec3 p = texelFetch(position, 2 * at, 0).xyz, n = texelFetch(normal, 2 * at, 0).xyz;
    vec4 sum = texelFetch(sums, at, 0);
    bool one = true, served = sum.a > 0.0;
    for (int i = 1; i < 4; ++i)
    {
        ivec2 other = min(at + ivec2(i & 1, i >> 1), last);
        vec3 q = texelFetch(position, 2 * other, 0).xyz, m = texelFetch(normal, 2 * other, 0).xyz;
        one = one && (texelFetch(sums, other, 0).a > 0.0) == served && (alike(p, n, q, m) || !served);
    }
    out_irradiance = vec4(sum.rgb / max(sum.a, 1e-20), texelFetch(weight, at, 0).r);
    out_plane = !one ? vec4(0.0) : served ? vec4(n, dot(n, p)) : vec4(0.0, 0.0, 0.0, 1.0);
}
