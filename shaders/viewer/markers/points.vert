// A record as a dot of constant size, if no surface hides it.
#include "viewer/markers/record.glsl"
#include "viewer/markers/hidden.glsl"

uniform float radius;  // of the dot, pixels

out vec2 v_at;  // pixels from the centre of the dot

void main()
{
    ivec2 texel = table_texel(gl_InstanceID);
    vec3 p = record_position(texel);
    vec4 clip = clip_from_world * vec4(p, 1.0);
    v_color = record_color(texel);
    v_at = (vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0) * (radius + 1.0);
    vec2 at = (clip.xy / clip.w * 0.5 + 0.5) * vec2(textureSize(position, 0));
    bool lost = clip.w <= 0.0 || any(greaterThan(abs(clip.xy), vec2(1.05 * clip.w))) || hidden(p, ivec2(floor(at)));
    gl_Position = lost ? vec4(0.0, 0.0, 2.0, 1.0) : moved(clip, v_at);  // four vertices in one place draw nothing
}
