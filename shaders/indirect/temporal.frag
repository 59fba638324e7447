// Temporal accumulation (METHOD.md, 8.4): a blend of the irradiance of records and holes with that of the last picture at the same
// world position.
#include "lib/same_surface.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;    // g-buffer
uniform sampler2D normal;
uniform sampler2D sums;        // Σ k·E, Σ k
uniform sampler2D shown;       // last picture: E/depth, 1/depth; 0 without irradiance; linearly filtered
uniform sampler2D shown_facing;  // last picture: facing_of the normals; linearly filtered
uniform mat4 clip_from_world;  // camera of the last picture
uniform vec4 shown_place;      // scale (xy) and offset (zw) from normalised device coordinates to `shown`
uniform int pixel_stride;      // pixels of the g-buffer per pixel of the sums, in x and y
uniform bool accumulating;     // true if there is a last picture
uniform bool kept;             // true if pixels without irradiance may keep that of the last picture
uniform float share;           // share s of the new irradiance, 0..1

layout(location = 0) out vec4 out_sums;    // E/depth, 1/depth; depth in metres
layout(location = 1) out float out_facing;  // facing_of the normal

const float OTHER_DEPTH = 0.02;  // relative difference of depth above which the last picture shows another surface
const float OTHER_FACING = 0.1;  // difference of facing_of above which the last picture shows another side

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(position, pixel * pixel_stride), s = texel_at(sums, pixel);
    // along a plane, 1/depth is linear on screen: the filtered value equals 1/depth only if all four pixels lie on one plane
    vec4 clip = clip_from_world * vec4(p.xyz, 1.0);  // w: depth in the last picture, metres
    vec2 uv = clip.xy / clip.w * shown_place.xy + shown_place.zw;
    vec4 last = textureLod(shown, uv, 0.0);
    out_facing = facing_of(texel_at(normal, pixel * pixel_stride).xyz);
    bool matches = abs(last.a * clip.w - 1.0) <= OTHER_DEPTH && abs(textureLod(shown_facing, uv, 0.0).r - out_facing) <= OTHER_FACING;
    // exposure meters black surfaces as soon as they have a little light: a share of the last light would never be 0
    bool black = s.a > 0.0 && s.rgb == vec3(0.0);
    bool reprojected = accumulating && p.w > 0.0 && matches && uv == clamp(uv, 0.0, 1.0) && !black;
    vec3 E = s.rgb / max(s.a, 1e-20), E_last = last.rgb / max(last.a, 1e-20);
    E = s.a > 0.0 ? (reprojected ? mix(E_last, E, share) : E) : E_last;
    bool has_light = p.w > 0.0 && (s.a > 0.0 || reprojected && kept);
    out_sums = has_light ? vec4(E, 1.0) / p.w : vec4(0.0);
}
