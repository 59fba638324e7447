// What the markers of records share: an instance is a record, coloured by its radius.
#include "records/view_radius.glsl"
#include "viewer/colours.glsl"

uniform mat4 clip_from_world;
uniform vec2 size;    // of the target in pixels
uniform vec2 span;    // where the colours begin, and by how much they advance per logarithm of a·R_k in metres

flat out vec3 v_color;

vec3 record_color(ivec2 texel)
{
    return heat((log(max(a * record_radius(texel), 1e-30)) - span.x) * span.y);
}

// A clip space point moved by so many pixels of the target.
vec4 moved(vec4 clip, vec2 pixels)
{
    return vec4(clip.xy + pixels * 2.0 / size * clip.w, clip.zw);
}

// The unit direction on screen, in pixels, in which a point goes that moves by `clip_step` in clip space.
vec2 heading(vec4 clip, vec4 clip_step)
{
    vec2 way = (clip_step.xy * clip.w - clip.xy * clip_step.w) * size;
    return way / max(length(way), 1e-20);
}
