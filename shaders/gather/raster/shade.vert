// The faces that records look through, each as a rectangle of the atlas: four vertices, and an instance for each face of each record.
#include "gather/raster/views.glsl"

uniform int faces;   // of a record
uniform vec2 atlas;  // texels

void main()
{
    ivec2 at = ivec2(gl_InstanceID / faces, gl_InstanceID % faces);
    vec4 cell = view_row(at, VIEW_CELL);
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    gl_Position = vec4((cell.xy + cell.zw * corner) * 2.0 / atlas - 1.0, 0.0, 1.0);
    view_of_texels(at);
}
