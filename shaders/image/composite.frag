// The picture (Jones 2010, 2.5; METHOD.md, 10.1): the outgoing radiance by direct light, indirect light, emission and sky.
#if FILTERS
#include "image/filtered.glsl"
#endif
#if SKY
#include "image/backdrop.glsl"
#endif
#include "image/gbuffer_material.glsl"
#include "lib/texel.glsl"

// FILTERS: 1 if filters may cover surfaces. EMISSIVE: 1 if any surface emits. SKY: 0 black, 1 uniform, 2 with a gradient, 3 map.

uniform sampler2D direct;  // direct radiance; a: 1 at a surface, else 0
uniform sampler2D sums;    // Σ k·E, Σ k
uniform vec2 blend;        // weights of direct and indirect light

layout(location = 0) out vec4 out_image;
layout(location = 1) out float out_alpha;  // 1 at a surface, else the opacity of filters

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
    bool surface = reflected.a > 0.0;
#if FILTERS
    out_image = vec4(surface ? filtered(pixel, light) : filtered_backdrop(pixel, gl_FragCoord.xy), 1.0);
    out_alpha = surface ? 1.0 : filter_opacity(pixel);
#else
    vec3 behind = vec3(0.0);
#if SKY == 1
    behind = sky;
#elif SKY
    behind = sky_behind(gl_FragCoord.xy);
#endif
    out_image = vec4(surface ? light : behind, 1.0);
    out_alpha = surface ? 1.0 : 0.0;
#endif
}
