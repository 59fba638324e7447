// A record's ellipse of radii a·R in this view, in its tangent plane, drawn as a strip of constant width.
#include "records/view_radius.glsl"
#include "viewer/colours.glsl"

in int in_number;            // of the record

uniform mat4 clip_from_world;
uniform vec2 size;           // size of the target, pixels
uniform vec2 span;           // log of a·R_k in metres at the first colour; advance of the colours, 0..1, per unit of that log
uniform float width;         // half the width of the strip, pixels
uniform float pixel;         // size of a pixel at distance 1, in metres
uniform int segments;        // greatest number of straight pieces of an ellipse
uniform sampler2D position;  // g-buffer; w depth along the view axis, 0 without a surface

flat out vec3 v_color;
out float v_side;

const float TURN = 6.28318530717959;
const float PIECES = 2.65;  // pieces of an ellipse per root of its radius in pixels: their error, r(1 - cos(π/n)), is 0.7 pixels

// Return the display colour of a record, by a·R_k.
vec3 record_color(ivec2 texel)
{
    return heat((log(max(a * record_radius(texel), 1e-30)) - span.x) * span.y);
}

// Return a clip space point, moved by `pixels` of the target.
vec4 moved(vec4 clip, vec2 pixels)
{
    return vec4(clip.xy + pixels * 2.0 / size * clip.w, clip.zw);
}

// Share of a disc's radius that may lie behind the visible surface, since a tangent disc dips into a curved surface.
const float DIP = 0.05;

// Return the distance in metres by which a point of a disc is hidden, negative for a visible point. A surface in front of the
// disc's plane hides the disc, and so does a surface nearer to the eye by more than the disc's radius. A test of depths alone is
// not enough, see plane.frag. Vertices are tested, since a test of all pixels costs a software renderer half as much again.
float hidden_by(vec4 clip, vec3 point, vec3 facing, float radius)
{
    vec2 at = (0.5 + 0.5 * clip.xy / clip.w) * vec2(textureSize(position, 0));
    vec4 q = texelFetch(position, ivec2(clamp(at, vec2(0.0), vec2(textureSize(position, 0) - 1))), 0);
    if (q.w <= 0.0) return -1.0;
    return max(dot(q.xyz - point, facing), clip.w - q.w - radius) - pixel * q.w - DIP * radius;
}

// Return the unit direction on screen, in pixels, of a point's motion by `clip_step` in clip space.
vec2 heading(vec4 clip, vec4 clip_step)
{
    vec2 direction = (clip_step.xy * clip.w - clip.xy * clip_step.w) * size;
    return direction / max(length(direction), 1e-20);
}

void main()
{
    ivec2 texel = table_texel(in_number);
    vec3 p = record_position(texel), n = record_normal(texel);
    float trust, distance = length(eye - p);
    Ellipse e = view_ellipse(texel, distance, trust);
    int pieces = clamp(int(PIECES * sqrt(e.along / (pixel * distance))), 6, segments);
    float angle = TURN * float(min(gl_VertexID >> 1, pieces)) / float(pieces);  // further vertices repeat the last one
    vec3 u = e.along * e.axis, v = e.across * cross(n, e.axis);
    vec3 direction = cos(angle) * v - sin(angle) * u;
    vec3 point = p + cos(angle) * u + sin(angle) * v;
    v_color = record_color(texel);
    v_side = gl_VertexID % 2 == 0 ? -width : width;
    vec4 clip = clip_from_world * vec4(point, 1.0);
    gl_ClipDistance[0] = -hidden_by(clip, point, dot(n, eye - p) < 0.0 ? -n : n, e.along);
    vec2 along = heading(clip, clip_from_world * vec4(direction, 0.0));
    gl_Position = moved(clip, v_side * vec2(-along.y, along.x));
}
