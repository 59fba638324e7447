// A record's weighted irradiance at a pixel, to be summed over all records (Jones 2010, section 2.2).
#include "lib/texel.glsl"
#include "records/weight.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
#if NORMAL_MAPS
uniform sampler2D lit_normal;  // bent by the normal map
#endif
uniform int pixel_stride;    // pixels of the g-buffer per pixel of the sums, in x and y: 1 or 2
#if REFINED
uniform sampler2D reach;     // the share of `a` that holds at each pixel of the sums
#endif

flat in vec3 v_place;
flat in vec3 v_normal;
flat in vec3 v_axis;
flat in vec2 v_radii;
flat in float v_share;
flat in float v_sure;
#if GRADIENTS
flat in vec2 v_curvature;
flat in mat3 v_m;
flat in mat3 v_g;
#else
flat in vec3 v_irradiance;
#endif

layout(location = 0) out vec4 out_sums;     // k·E, k
layout(location = 1) out vec2 out_weight;   // w, and k·(Y² - σ²): Y is the luminance of E, σ its noise

#if NORMAL_MAPS
// The irradiance on a normal m bent away from the surface's own n, where it is E = n·M. n·M and m·M count light below m's horizon as
// negative; the visible part of it is a lune of n's hemisphere. Let t be the direction in which m is tilted, and the light affine in the
// direction. Then the lune has (1 - n·m)·(E/2 - 2/π·M·t), to second order (docs/METHOD.md, 4.1).
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
    vec3 apart = p.xyz - v_place, n = texel_at(normal, pixel).xyz;
    float w = record_weight(apart, v_axis, v_radii, n, v_normal);
    float least = 1.0 / a;
#if REFINED
    least /= texel_at(reach, ivec2(gl_FragCoord.xy)).r;
#endif
    if (w <= least) discard;
#if GRADIENTS
    vec3 E = turned(v_m, n, v_normal);
#if NORMAL_MAPS
    E += bent_irradiance(n * v_m, n, texel_at(lit_normal, pixel).xyz, v_m) - n * v_m;
#endif
#else
    vec3 E = v_irradiance;
#endif
    // w - 1/a falls to zero at the rim of the record's sphere, so that the rim does not show; the paper's kernel ends with a step
    float k = v_share * (hessian ? w - least : w);
#if GRADIENTS
    // (p - p_k)·∇E: the gradient moves with the point
    float Y_k = dot(E, LUMINANCE);
    E = extrapolated(E, apart * v_g, apart, v_normal, v_axis, v_curvature);
    float known = known_share(Y_k, dot(E, LUMINANCE));
    w *= known;
    k *= known;
#endif
    out_sums = k * vec4(E, 1.0);
    float Y = dot(E, LUMINANCE);
    out_weight = vec2(w, k * Y * Y * v_sure);
}
