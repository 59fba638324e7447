// Filters before what the g-buffer holds: surfaces that let most of the light pass. Of all of them the product of what they leave of
// it, which needs no order; with GLOW the sum of what they emit, untinted by each other; with NEAREST the opacity of the nearest one.
#include "generated/interpolated.glsl"
#include "image/texture_map.glsl"
#include "lib/material_table.glsl"

in vec3 v_position;

uniform vec3 eye;
uniform vec3 forward;        // unit, the view axis
uniform float far;           // metres, beyond the farthest corner of the scene
uniform float alpha_cutoff;  // with MASK: the least alpha at which there is anything

#if NEAREST
layout(location = 0) out float out_opacity;
#else
layout(location = 0) out vec4 out_tint;  // the share of what is behind that is seen, or the radiance that is added
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
    // what reaches the cutoff stands in the g-buffer, and what is fully transparent is no surface
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
