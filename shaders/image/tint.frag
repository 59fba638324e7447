// Filters in front of the g-buffer: surfaces that transmit most of the light. The result is the product of their transmittances,
// which needs no order. GLOW: 1 for the sum of their emission, without mutual tint. NEAREST: 1 for the opacity of the nearest
// filter.
#include "generated/interpolated.glsl"
#include "image/texture_map.glsl"
#include "lib/material_table.glsl"

in vec3 v_position;

uniform vec3 eye;            // world space, metres
uniform vec3 forward;        // unit, the view axis
uniform float far;           // depth beyond the farthest corner of the scene, metres
uniform float alpha_cutoff;  // least alpha of a visible surface with MASK

#if NEAREST
layout(location = 0) out float out_opacity;
#else
layout(location = 0) out vec4 out_tint;  // transmittance, or emitted radiance
#endif

void main()
{
    Material material = material_factors(interpolated_vertex(v_position));
    float alpha = v_opacity;
#if ALBEDO_MAP
    vec4 texel = albedo_texel(v_uv);
    material.albedo *= texel.rgb;
    alpha *= texel.a;
#endif
#if EMISSION_MAP
    material.emission *= map_texel(emission_map, emission_from_uv * v_uv + emission_place.xy, emission_place.zw).rgb;
#endif
#if MASK
    if (alpha < alpha_cutoff) discard;
#endif
#if !BLEND
    alpha = 1.0;
#endif
    // a surface above the cutoff is in the g-buffer; a fully transparent surface is no filter
    if (alpha >= material_row(int(v_material), MATERIAL_EMISSION).w || alpha <= 0.0) discard;
#if NEAREST
    out_opacity = alpha;
#elif GLOW
    out_tint = vec4(alpha * material.emission, 1.0);
#else
    out_tint = vec4(1.0 - alpha * (1.0 - clamp(material.albedo, 0.0, 1.0)), 1.0);
#endif
    gl_FragDepth = dot(v_position - eye, forward) / far;
}
