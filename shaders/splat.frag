// What a record says of a pixel, added up: Ward et al. 1988's weight, w = 1/(|p - p_k|/R_k + √(1 - n·n_k)).
#include "lib/weight.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform bool cut;            // the paper's kernel: w as it is, cut off at 1/a
uniform bool in_front;       // reject records in front of the pixel's surface, or behind it

flat in vec4 v_record;
flat in vec3 v_normal;
#if GRADIENTS
flat in mat3 v_m;
flat in mat3 v_g;
#else
flat in vec3 v_irradiance;
#endif

layout(location = 0) out vec4 out_sums;     // k·E, k
layout(location = 1) out float out_weight;  // w

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 p = texelFetch(position, pixel, 0);
    vec3 apart = p.xyz - v_record.xyz;
    float limit = a * v_record.w;
    if (p.w == 0.0 || dot(apart, apart) >= limit * limit) discard;
    vec3 n = texelFetch(normal, pixel, 0).xyz;
    float w = record_weight(apart, v_record.w, n, v_normal, in_front);
    if (w <= 1.0 / a) discard;
    // w - 1/a reaches zero at the rim, so that no circle shows; the paper's own kernel stops short of that
    float k = cut ? w : w - 1.0 / a;
#if GRADIENTS
    // E = n·M + (p - p_k)·∇E: the irradiance vector turns with the normal, the gradient moves with the point
    vec3 E = n * v_m;
    E = clamp(E + apart * v_g, vec3(0.0), max(2.0 * E, 0.0));  // no extrapolation below black or beyond twice itself
#else
    vec3 E = v_irradiance;
#endif
    out_sums = k * vec4(E, 1.0);
    out_weight = w;
}
