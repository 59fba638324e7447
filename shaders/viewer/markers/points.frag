// A dot in its record's colour, with a light ring and a dark rim, so that it is visible on any ground.
uniform float radius;  // of the dot, pixels

flat in vec3 v_color;
in vec2 v_at;

layout(location = 0) out vec4 out_color;

void main()
{
    float d = length(v_at);
    vec3 color = mix(vec3(0.0), vec3(1.0), clamp(radius - 0.5 - d, 0.0, 1.0));
    color = mix(color, v_color, clamp(radius - 1.25 - d, 0.0, 1.0));
    out_color = vec4(color, clamp(radius + 0.5 - d, 0.0, 1.0));
}
