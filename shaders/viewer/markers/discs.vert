// A record's ellipse of radii a·R in this view, in its tangent plane, drawn as a strip of constant width.
#include "viewer/markers/record.glsl"

uniform float width;   // half the width of the strip, pixels
uniform int segments;  // number of straight pieces of an ellipse

out vec3 v_position;
out float v_side;
flat out vec4 v_disc;

const float TURN = 6.28318530717959;

void main()
{
    ivec2 texel = table_texel(gl_InstanceID);
    vec3 p = record_position(texel), n = record_normal(texel);
    float trust, angle = TURN * float(gl_VertexID >> 1) / float(segments);
    Ellipse e = view_ellipse(texel, length(eye - p), trust);
    vec3 u = e.along * e.axis, v = e.across * cross(n, e.axis);
    vec3 way = cos(angle) * v - sin(angle) * u;
    v_position = p + cos(angle) * u + sin(angle) * v;
    v_color = record_color(texel);
    v_side = gl_VertexID % 2 == 0 ? -width : width;
    v_disc = vec4(dot(n, eye - p) < 0.0 ? -n : n, e.along);
    vec4 clip = clip_from_world * vec4(v_position, 1.0);
    vec2 along = heading(clip, clip_from_world * vec4(way, 0.0));
    gl_Position = moved(clip, v_side * vec2(-along.y, along.x));
}
