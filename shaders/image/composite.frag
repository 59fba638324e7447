// The picture: irradiance from the sums, and with it the outgoing radiance of direct light, indirect light, emission and sky.
#include "generated/gbuffer_material.glsl"
#if FILTERS
#include "image/filtered.glsl"
#endif
#if SKY
#include "image/backdrop.glsl"
#endif
#include "lib/material.glsl"
#include "lib/texel.glsl"

// FILTERS: 1 where surfaces may be seen through filters. EMISSIVE: 1 where any surface emits. SKY: the sky that is seen behind:
// 0 black, 1 the same everywhere, 2 brighter above, 3 a map.

uniform sampler2D direct;  // a: 1 where a surface is seen
uniform sampler2D sums;    // Σ k·E, Σ k
uniform vec2 blend;        // weights of direct and indirect light

layout(location = 0) out vec4 out_image;
layout(location = 1) out float out_alpha;  // 1 on a surface, else the share of light that filters absorb

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 s = texel_at(sums, pixel), reflected = texel_at(direct, pixel);
    vec3 E = s.a > 0.0 ? s.rgb / s.a : vec3(0.0);
    Material material = material_at(pixel);
    vec3 indirect = reflected_radiance(material, E);
    vec3 light = blend.x * reflected.rgb + blend.y * indirect;
#if EMISSIVE
    light += material.emission;
#endif
    bool seen = reflected.a > 0.0;
#if FILTERS
    out_image = vec4(seen ? filtered(pixel, light) : filtered_backdrop(pixel, gl_FragCoord.xy), 1.0);
    out_alpha = seen ? 1.0 : held_back(pixel);
#else
    vec3 behind = vec3(0.0);
#if SKY == 1
    behind = sky;
#elif SKY
    behind = sky_behind(gl_FragCoord.xy);
#endif
    out_image = vec4(seen ? light : behind, 1.0);
    out_alpha = seen ? 1.0 : 0.0;
#endif
}
