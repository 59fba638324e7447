// Temporal accumulation: a share of the records' present irradiance, and for the remainder the last picture's irradiance at the place
// in the world. The depth buffer marks pixels without either of them for surface_fill.frag.
#include "lib/same_surface.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;    // g-buffer
uniform sampler2D normal;
uniform sampler2D sums;        // Σ k·E, Σ k
uniform sampler2D shown;       // the last picture's E/depth, 1/depth; 0 without irradiance; linearly filtered
uniform sampler2D shown_facing;  // facing_of of its surfaces; linearly filtered
uniform vec3 dimming;          // factors on its irradiance: all light has changed by these since
uniform mat4 clip_from_world;  // of the last picture
uniform vec4 shown_place;      // scale and offset from clip space to `shown`
uniform int pixel_stride;      // pixels of the g-buffer per pixel of the sums, in x and y
uniform bool accumulating;     // true if there is a last picture; else the records decide alone
uniform bool filling;          // true if pixels without records take the last picture's irradiance, or are marked
uniform bool kept;             // true if pixels without records keep the irradiance of the last picture
uniform float share;           // of the records' irradiance, 0..1

layout(location = 0) out vec4 out_sums;    // E/depth, 1/depth
layout(location = 1) out float out_facing;

const float OTHER_DEPTH = 0.02;  // relative difference of depth above which a reprojected pixel is another surface
const float OTHER_FACING = 0.1;  // difference of facing_of above which it is another side

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(position, pixel * pixel_stride), s = texel_at(sums, pixel);
    // along a plane, 1/depth is linear on screen: between four pixels of one plane it is that of the place, and else not
    vec4 clip = clip_from_world * vec4(p.xyz, 1.0);  // w: depth in the last picture
    vec2 place = clip.xy / clip.w * shown_place.xy + shown_place.zw;
    vec4 before = textureLod(shown, place, 0.0);
    out_facing = facing_of(texel_at(normal, pixel * pixel_stride).xyz);
    bool same = abs(before.a * clip.w - 1.0) <= OTHER_DEPTH && abs(textureLod(shown_facing, place, 0.0).r - out_facing) <= OTHER_FACING;
    bool known = accumulating && p.w > 0.0 && same && place == clamp(place, 0.0, 1.0);
    vec3 E = s.rgb / max(s.a, 1e-20), E_before = dimming * before.rgb / max(before.a, 1e-20);
    E = s.a > 0.0 ? (known ? mix(E_before, E, share) : E) : E_before;
    bool shows = p.w > 0.0 && (s.a > 0.0 || filling && known && kept);
    out_sums = shows ? vec4(E, 1.0) / p.w : vec4(0.0);
    gl_FragDepth = filling && p.w > 0.0 && !shows ? 1.0 : 0.0;
}
