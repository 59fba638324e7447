// A parallelogram in the scene.
uniform mat4 clip_from_world;
uniform vec3 corner;  // metres
uniform vec3 u;       // edges of the parallelogram, metres
uniform vec3 v;

out vec3 v_position;
out vec2 v_at;  // 0..1 along u and v

void main()
{
    v_at = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    v_position = corner + v_at.x * u + v_at.y * v;
    gl_Position = clip_from_world * vec4(v_position, 1.0);
}
