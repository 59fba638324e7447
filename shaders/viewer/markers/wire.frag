// The edges of the scene's triangles, without their hidden parts.
#include "viewer/markers/hidden.glsl"

uniform vec2 scale;  // pixels of the view per pixel of the target
uniform vec4 tint;

in vec3 v_position;

layout(location = 0) out vec4 out_color;

void main()
{
    if (hidden(v_position, ivec2(gl_FragCoord.xy * scale))) discard;
    out_color = tint;
}
