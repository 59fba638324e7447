// Antialiasing: blend one more sample per pixel, off its centre, into the mean of the samples so far (METHOD.md, 10.3).
#include "image/backdrop.glsl"
#include "image/filtered.glsl"
#include "image/gbuffer_material.glsl"

uniform sampler2D position;  // g-buffer of the sample
uniform sampler2D direct;    // direct radiance of the sample
uniform sampler2D sums;      // Σ k·E, Σ k of the sample
uniform sampler2D centre;    // Σ k·E, Σ k of the pixels' centres
uniform vec2 blend;          // weights of direct and indirect light
uniform float share;         // weight of this sample in the mean: 1/n for the n-th

layout(location = 0) out vec4 out_image;  // a: `share`, the blend factor of the draw
layout(location = 1) out vec4 out_direct;
layout(location = 2) out vec4 out_indirect;
layout(location = 3) out vec4 out_emission;
layout(location = 4) out vec4 out_alpha;     // r: share of the samples with a surface

// Return the sums of a sample, or of its neighbours, or of the pixel's centre, because records may miss samples off the centre.
vec4 covered_sums(ivec2 pixel)
{
    vec4 s = texelFetch(sums, pixel, 0);
    if (s.a > COVERED) return s;
    ivec2 last = textureSize(sums, 0) - 1;
    s = vec4(0.0);
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) s += texelFetch(sums, clamp(pixel + ivec2(x, y), ivec2(0), last), 0);
    return s.a > COVERED ? s : texelFetch(centre, pixel, 0);
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 direct_light = vec3(0.0), indirect = vec3(0.0), emitted;
    bool surface = texelFetch(position, pixel, 0).w > 0.0;
    if (surface)
    {
        vec4 s = covered_sums(pixel);
        Material material = material_at(pixel);
        indirect = reflected_radiance(material, s.a > 0.0 ? s.rgb / s.a : vec3(0.0));
        direct_light = texelFetch(direct, pixel, 0).rgb;
        emitted = material.emission;
    }
    else emitted = backdrop_radiance(gl_FragCoord.xy);
    vec3 light = blend.x * direct_light + blend.y * indirect + emitted;
    out_image = vec4(surface ? filtered(pixel, light) : filtered_backdrop(pixel, gl_FragCoord.xy), share);
    out_direct = vec4(direct_light, share);
    out_indirect = vec4(indirect, share);
    out_emission = vec4(emitted, share);
    out_alpha = vec4(surface ? 1.0 : filter_opacity(pixel), 0.0, 0.0, share);
}
