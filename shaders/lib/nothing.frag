// Clears the g-buffer's positions at pixels without a surface: depth 0 marks them.
layout(location = 0) out vec4 out_position;

void main()
{
    out_position = vec4(0.0);
}
