// Nothing seen: the g-buffer's positions before surfaces are drawn over them.
layout(location = 0) out vec4 out_position;

void main()
{
    out_position = vec4(0.0);
}
