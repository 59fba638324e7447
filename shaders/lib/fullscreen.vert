// One triangle that fills the target: vertices 0, 1, 2 at (-1,-1), (3,-1), (-1,3).
#ifndef DEPTH
#define DEPTH 0.0  // in clip space, -1..1
#endif

void main()
{
    gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, DEPTH, 1.0);
}
