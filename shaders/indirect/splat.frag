// Splat of a record at a pixel: weighted irradiance and weight, which additive blending sums over all records (Jones 2010, 2.2;
// METHOD.md, 4.6, 5.1, 6.2).
#include "lib/texel.glsl"
#include "records/weight.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
#if NORMAL_MAPS
uniform sampler2D lit_normal;  // unit normal with the normal map
#endif
uniform int pixel_stride;    // pixels of the g-buffer per pixel of the sums, in x and y: 1 or 2
#if REFINED
uniform sampler2D reach;     // valid share of the records' reach at each pixel of the sums (METHOD.md, 8.3)
#endif

// see splat_outputs.glsl
flat in vec3 v_position;
flat in vec3 v_normal;
flat in vec3 v_axis;
flat in vec2 v_radii;
flat in float v_factor;
flat in float v_signal;
#if GRADIENTS
flat in vec2 v_curvature;
flat in mat3 v_m;
flat in mat3 v_g;
#else
flat in vec3 v_irradiance;
#endif

layout(location = 0) out vec4 out_sums;     // k·E, k
layout(location = 1) out vec2 out_weight;   // w, and k·(Y² - σ²) with the luminance Y of E and the standard error σ of Y

#if NORMAL_MAPS
// Return the irradiance at the normal m of a normal map, with E = n·M at the surface's normal n. m·M counts the light between the
// horizons of n and m as negative. If m is tilted towards t and the light is affine in the direction, this lune has
// (1 - n·m)·(E/2 - 2/π·M·t), to second order (METHOD.md, 4.1).
vec3 bent_irradiance(vec3 E, vec3 n, vec3 m, mat3 M)
{
    float c = clamp(dot(n, m), 0.0, 1.0);
    vec3 bent = m * M, sideways = (bent - c * E) * sqrt((1.0 - c) / (1.0 + c));  // (1 - c)·M·t
    return bent + max((1.0 - c) * 0.5 * E - 2.0 * INV_PI * sideways, 0.0);
}
#endif

void main()
{
    ivec2 pixel = pixel_stride * ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(position, pixel);
    if (p.w == 0.0) discard;
    vec3 offset = p.xyz - v_position, n = texel_at(normal, pixel).xyz;
    float w = record_weight(offset, v_axis, v_radii, n, v_normal);
    float least = 1.0 / a;
#if REFINED
    least /= texel_at(reach, ivec2(gl_FragCoord.xy)).r;
#endif
    if (w <= least) discard;
#if GRADIENTS
    vec3 E = rotated_irradiance(v_m, n, v_normal);
#if NORMAL_MAPS
    E += bent_irradiance(n * v_m, n, texel_at(lit_normal, pixel).xyz, v_m) - n * v_m;
#endif
#else
    vec3 E = v_irradiance;
#endif
    // w - 1/a is continuous at the rim of the record, so that the rim is invisible; the paper's kernel has a step at the rim
    float k = v_factor * (hessian ? w - least : w);
#if GRADIENTS
    // offset·∇E is the first order of the expansion
    float Y_k = dot(E, LUMINANCE);
    E = extrapolated_irradiance(E, offset * v_g, offset, v_normal, v_axis, v_curvature);
    float factor = weight_factor(Y_k, dot(E, LUMINANCE));
    w *= factor;
    k *= factor;
#endif
    out_sums = k * vec4(E, 1.0);
    float Y = dot(E, LUMINANCE);
    out_weight = vec2(w, k * Y * Y * v_signal);
}
