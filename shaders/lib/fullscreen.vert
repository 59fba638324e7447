// Full-screen passes: one triangle that covers the target, with corners (-1,-1), (3,-1), (-1,3) in clip space.
#ifndef DEPTH
#define DEPTH 0.0  // clip space, -1..1
#endif

void main()
{
    gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, DEPTH, 1.0);
}
