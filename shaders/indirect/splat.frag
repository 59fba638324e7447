// A record's weighted irradiance at a pixel, to be summed over all records (Jones 2010, section 2.2).
#include "records/weight.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform int pixel_stride;    // pixels of the g-buffer per pixel of the sums, in x and y: 1 or 2
uniform bool cut;            // the paper's kernel: w itself, cut off where it falls to 1/a
uniform bool in_front;       // reject records in front of the pixel's surface or behind it

flat in vec3 v_place;
flat in vec3 v_normal;
flat in vec3 v_axis;
flat in vec2 v_radii;
#if GRADIENTS
flat in vec2 v_curvature;
flat in vec4 v_walls;
flat in mat3 v_m;
flat in mat3 v_g;
#else
flat in vec3 v_irradiance;
#endif

layout(location = 0) out vec4 out_sums;     // k·E, k
layout(location = 1) out vec2 out_weight;   // w, and k·Y², where Y is the luminance of E

void main()
{
    ivec2 pixel = pixel_stride * ivec2(gl_FragCoord.xy);
    vec4 p = texelFetch(position, pixel, 0);
    if (p.w == 0.0) discard;
    vec3 apart = p.xyz - v_place, n = texelFetch(normal, pixel, 0).xyz;
#if GRADIENTS
    if (behind_wall(apart, v_axis, v_normal, v_walls)) discard;
#endif
    float w = record_weight(apart, v_axis, v_radii, n, v_normal, in_front);
    if (w <= 1.0 / a) discard;
    // w - 1/a falls to zero at the rim of the record's sphere, so that the rim does not show; the paper's kernel ends with a step
    float k = cut ? w : w - 1.0 / a;
#if GRADIENTS
    // E = n·M + (p - p_k)·∇E: the irradiance vector turns with the normal, the gradient moves with the point
    vec3 E = extrapolated(n * v_m, apart * v_g, apart, v_normal, v_axis, v_curvature);
#else
    vec3 E = v_irradiance;
#endif
    out_sums = k * vec4(E, 1.0);
    float Y = dot(E, LUMINANCE);
    out_weight = vec2(w, k * Y * Y);
}
