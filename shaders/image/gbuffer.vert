// The scene as the camera sees it.
#include "generated/attributes.glsl"

in vec3 in_position;

uniform mat4 clip_from_world;

out vec3 v_position;

void main()
{
    gl_Position = clip_from_world * vec4(in_position, 1.0);
    v_position = in_position;
    pass_attributes();
}
