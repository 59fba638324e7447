// A line from a record along its normal.
#include "viewer/markers/record.glsl"

uniform float width;  // half of it, pixels
uniform float rise;   // length of the line at distance 1, metres

out vec3 v_position;
out float v_side;

void main()
{
    ivec2 texel = table_texel(gl_InstanceID);
    vec3 p = record_position(texel), n = record_normal(texel);
    v_position = p + float(gl_VertexID >> 1) * rise * length(eye - p) * n;
    v_color = record_color(texel);
    v_side = gl_VertexID % 2 == 0 ? -width : width;
    vec4 clip = clip_from_world * vec4(v_position, 1.0);
    vec2 along = heading(clip, clip_from_world * vec4(n, 0.0));
    gl_Position = moved(clip, v_side * vec2(-along.y, along.x));
}
