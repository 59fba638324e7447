// Shared code of the markers of records. An instance is a record, coloured by its radius.
#include "records/view_radius.glsl"
#include "viewer/colours.glsl"

uniform mat4 clip_from_world;
uniform vec2 size;    // size of the target, pixels
uniform vec2 span;    // log of a·R_k in metres at the first colour; advance of the colours, 0..1, per unit of that log

flat out vec3 v_color;

vec3 record_color(ivec2 texel)
{
    return heat((log(max(a * record_radius(texel), 1e-30)) - span.x) * span.y);
}

// A clip space point, moved by `pixels` of the target.
vec4 moved(vec4 clip, vec2 pixels)
{
    return vec4(clip.xy + pixels * 2.0 / size * clip.w, clip.zw);
}

// The unit direction on screen, in pixels, of a point's motion by `clip_step` in clip space.
vec2 heading(vec4 clip, vec4 clip_step)
{
    vec2 way = (clip_step.xy * clip.w - clip.xy * clip_step.w) * size;
    return way / max(length(way), 1e-20);
}
