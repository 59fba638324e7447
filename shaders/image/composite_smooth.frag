// Indirect light smoothed along surfaces, not across their edges: the paper's second remedy for its artefacts.
uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform sampler2D sums;      // Σ k·E, Σ k
uniform int smooth_radius;   // pixels
uniform float pixel_size;    // of a pixel at distance 1, in metres

layout(location = 0) out vec4 out_sums;  // E, 1

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = textureSize(position, 0) - 1;
    vec4 p = texelFetch(position, pixel, 0);
    out_sums = vec4(0.0);
    if (p.w == 0.0) return;
    // neighbours count the more, the closer they are to the pixel's tangent plane and to its normal
    vec3 n = texelFetch(normal, pixel, 0).xyz;
    float thickness = 2.0 * float(smooth_radius) * pixel_size * p.w, sigma = 0.5 * float(smooth_radius);
    vec4 total = vec4(0.0);
    for (int y = -smooth_radius; y <= smooth_radius; ++y)
        for (int x = -smooth_radius; x <= smooth_radius; ++x)
        {
            ivec2 other = clamp(pixel + ivec2(x, y), ivec2(0), last);
            vec4 q = texelFetch(position, other, 0), s = texelFetch(sums, other, 0);
            if (q.w == 0.0 || s.a <= 0.0) continue;
            float off = dot(q.xyz - p.xyz, n) / thickness;
            float cosine = max(dot(texelFetch(normal, other, 0).xyz, n), 0.0);
            float w = exp(-0.5 * float(x * x + y * y) / (sigma * sigma) - 4.0 * off * off) * pow(cosine, 32.0);
            total += w * vec4(s.rgb / s.a, 1.0);
        }
    if (total.a > 0.0) out_sums = vec4(total.rgb / total.a, 1.0);
}
