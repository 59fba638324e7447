// Which triangle is seen: its place in the order of the meshlets, counted from 1, so that 0 is none.
uniform ivec2 piece;  // the meshlet's first pair, and its first triangle

layout(location = 0) out float out_triangle;

void main()
{
    out_triangle = float(piece.y + gl_PrimitiveID + 1);
}
