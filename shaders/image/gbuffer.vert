// The g-buffer (Jones 2010, 3.2): draws the scene from the camera.
#include "generated/attributes.glsl"

in vec3 in_position;

uniform mat4 clip_from_world;

out vec3 v_position;  // world space, metres

void main()
{
    gl_Position = clip_from_world * vec4(in_position, 1.0);
    v_position = in_position;
    pass_attributes();
}
