// The scene as the camera sees it.
in vec3 in_position;
in vec3 in_normal;
in vec3 in_albedo;
in vec3 in_emission;

uniform mat4 clip_from_world;

out vec3 v_position;
out vec3 v_normal;
out vec3 v_albedo;
out vec3 v_emission;

void main()
{
    gl_Position = clip_from_world * vec4(in_position, 1.0);
    v_position = in_position;
    v_normal = in_normal;
    v_albedo = in_albedo;
    v_emission = in_emission;
}
