// One triangle that fills the target behind all surfaces, whose depths are below 0.992, and before the empty depth buffer's 1.
void main()
{
    gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.9998, 1.0);
}
