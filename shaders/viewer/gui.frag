// The interface's colours: sRGB values, written as they are.
uniform sampler2D glyphs;  // the font's atlas, or a picture

in vec2 v_uv;
in vec4 v_color;

layout(location = 0) out vec4 out_color;

void main()
{
    out_color = v_color * texture(glyphs, v_uv);
}
