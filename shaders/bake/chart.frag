// Which point of which triangle a texel of a lightmap is.
flat in int v_triangle;
in vec2 v_share;

layout(location = 0) out vec4 out_place;  // the triangle's number + 1, the shares of its second and third corner

void main()
{
    out_place = vec4(float(v_triangle + 1), v_share, 1.0);
}
