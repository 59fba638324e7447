// Nothing seen: the g-buffer's positions where no surface was drawn.
layout(location = 0) out vec4 out_position;

void main()
{
    out_position = vec4(0.0);
}
