// An ellipse in its record's colour with dark sides, where it is not hidden.
#include "viewer/markers/line.glsl"

uniform sampler2D position;  // g-buffer; w depth along the view axis, 0 where nothing is seen
uniform float pixel;         // size of a pixel at distance 1, in metres
uniform vec2 scale;          // pixels of the view per pixel of the target

flat in vec4 v_disc;         // its normal, turned to the eye, and its greater radius in metres
in vec3 v_position;

// On a curved surface a tangent disc dips into it: share of its radius that may lie behind the visible surface.
const float DIP = 0.05;

void main()
{
    // Hidden by what lies in front of the disc's own plane, or before it by more than the disc is wide; depths alone won't do,
    // see overlay_hidden.glsl. That one's test is as good, but costs a software renderer twice as much.
    vec4 q = texelFetch(position, ivec2(gl_FragCoord.xy * scale), 0);
    float slack = pixel * q.w + DIP * v_disc.w, depth = 1.0 / gl_FragCoord.w;
    if (q.w > 0.0 && (dot(q.xyz - v_position, v_disc.xyz) > slack || depth - q.w > v_disc.w + slack)) discard;
    out_color = line();
}
