// The pixels to which a record contributes, see indirect/splat.frag; opacity by weight.
#include "records/weight.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform vec2 scale;          // pixels of the view per pixel of the target
uniform vec3 tint;           // display colour

flat in vec3 v_position;
flat in vec3 v_normal;
flat in vec3 v_axis;
flat in vec2 v_radii;

layout(location = 0) out vec4 out_color;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy * scale);
    vec4 p = texelFetch(position, pixel, 0);
    if (p.w == 0.0) discard;
    vec3 offset = p.xyz - v_position;
    float w = record_weight(offset, v_axis, v_radii, texelFetch(normal, pixel, 0).xyz, v_normal);
    if (w <= 1.0 / a) discard;
    out_color = vec4(tint, mix(0.85, 0.4, 1.0 / (a * w)));
}
