// What a record says of a pixel, added up: Ward et al. 1988's weight, w = 1/(|p - p_k|/R_k + √(1 - n·n_k)).
#include "records/weight.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform int every;           // 1: all of its pixels are served; 2: every other one
uniform bool cut;            // the paper's kernel: w as it is, cut off at 1/a
uniform bool in_front;       // reject records in front of the pixel's surface, or behind it

flat in vec3 v_place;
flat in vec3 v_normal;
flat in vec3 v_axis;
flat in vec2 v_radii;
#if GRADIENTS
flat in vec2 v_bend;
flat in vec4 v_walls;
flat in mat3 v_m;
flat in mat3 v_g;
#else
flat in vec3 v_irradiance;
#endif

layout(location = 0) out vec4 out_sums;     // k·E, k
layout(location = 1) out vec2 out_weight;   // w, and k·Y², Y being the luminance of E

void main()
{
    ivec2 pixel = every * ivec2(gl_FragCoord.xy);
    vec4 p = texelFetch(position, pixel, 0);
    if (p.w == 0.0) discard;
    vec3 apart = p.xyz - v_place, n = texelFetch(normal, pixel, 0).xyz;
#if GRADIENTS
    if (record_beyond(apart, v_axis, v_normal, v_walls)) discard;
#endif
    float w = record_weight(apart, v_axis, v_radii, n, v_normal, in_front);
    if (w <= 1.0 / a) discard;
    // w - 1/a reaches zero at the rim, so that no circle shows; the paper's own kernel stops short of that
    float k = cut ? w : w - 1.0 / a;
#if GRADIENTS
    // E = n·M + (p - p_k)·∇E: the irradiance vector turns with the normal, the gradient moves with the point
    vec3 E = record_says(n * v_m, apart * v_g, apart, v_normal, v_axis, v_bend);
#else
    vec3 E = v_irradiance;
#endif
    out_sums = k * vec4(E, 1.0);
    float Y = dot(E, LUMINANCE);
    out_weight = vec2(w, k * Y * Y);
}
