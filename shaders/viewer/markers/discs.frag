// An ellipse in its record's colour with dark sides, times alpha.
uniform float width;   // half the width of the line, pixels

flat in vec3 v_color;
in float v_side;       // pixels from the middle of the line

layout(location = 0) out vec4 out_color;

// Return the colour of the record with dark sides, so that the line is visible on any background.
vec4 line()
{
    float d = abs(v_side), core = clamp(1.25 - d, 0.0, 1.0);
    return vec4(v_color * core, mix(0.6 * clamp(width - d, 0.0, 1.0), 1.0, core));
}

void main()
{
    vec4 shown = line();
    out_color = vec4(shown.rgb * shown.a, shown.a);
}
