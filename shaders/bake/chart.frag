// Baking: triangle and barycentric coordinates of a lightmap's texel.
flat in int v_triangle;
in vec2 v_barycentric;

layout(location = 0) out vec4 out_place;  // number of the triangle + 1, barycentric coordinates of the second and third corner

void main()
{
    out_place = vec4(float(v_triangle + 1), v_barycentric, 1.0);
}
