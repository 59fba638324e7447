// A normal in its record's colour with dark sides, where it is not hidden.
#include "viewer/markers/hidden.glsl"
#include "viewer/markers/line.glsl"

uniform vec2 scale;  // pixels of the view per pixel of the target

in vec3 v_position;

void main()
{
    if (hidden(v_position, ivec2(gl_FragCoord.xy * scale))) discard;
    out_color = line();
}
