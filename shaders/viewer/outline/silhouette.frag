// 1 where a mesh is, hidden or not.
layout(location = 0) out float out_inside;

void main()
{
    out_inside = 1.0;
}
