// The colour of a line: its record's, with dark sides, so that it is seen on any ground.
uniform float width;  // half of it, pixels

flat in vec3 v_color;
in float v_side;      // pixels from the middle

layout(location = 0) out vec4 out_color;

vec4 line()
{
    float d = abs(v_side), core = clamp(1.25 - d, 0.0, 1.0);
    return vec4(v_color * core, mix(0.6 * clamp(width - d, 0.0, 1.0), 1.0, core));
}
