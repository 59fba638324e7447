// One more sample of every pixel: what is seen there beside its centre, blended into the mean of all samples so far.
#include "generated/constants.glsl"

uniform sampler2D position;  // the sample's g-buffer
uniform sampler2D albedo;
uniform sampler2D emission;
uniform sampler2D direct;
uniform sampler2D sums;      // its Σ k·E, Σ k
uniform sampler2D centre;    // the same of the pixels' centres
uniform vec2 blend;          // weights of direct and indirect
uniform vec3 sky;
uniform float share;         // of the sample in the mean: 1/n of the n-th

layout(location = 0) out vec4 out_image;  // a, by which they are blended: the share
layout(location = 1) out vec4 out_direct;
layout(location = 2) out vec4 out_indirect;
layout(location = 3) out vec4 out_emission;

// No record speaks for a place that no pixel's centre asked for: those around it are asked, then the pixel's own centre.
vec4 borrowed(ivec2 pixel)
{
    ivec2 last = textureSize(sums, 0) - 1;
    vec4 s = vec4(0.0);
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) s += texelFetch(sums, clamp(pixel + ivec2(x, y), ivec2(0), last), 0);
    return s.a > 0.0 ? s : texelFetch(centre, pixel, 0);
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 direct_light = vec3(0.0), indirect = vec3(0.0), own = sky;
    if (texelFetch(position, pixel, 0).w > 0.0)
    {
        vec4 s = texelFetch(sums, pixel, 0);
        if (s.a <= 0.0) s = borrowed(pixel);
        indirect = texelFetch(albedo, pixel, 0).rgb * INV_PI * (s.a > 0.0 ? s.rgb / s.a : vec3(0.0));
        direct_light = texelFetch(direct, pixel, 0).rgb;
        own = texelFetch(emission, pixel, 0).rgb;
    }
    out_image = vec4(blend.x * direct_light + blend.y * indirect + own, share);
    out_direct = vec4(direct_light, share);
    out_indirect = vec4(indirect, share);
    out_emission = vec4(own, share);
}
