// The planes of triangles.
#include "lib/normals.glsl"
#include "lib/table.glsl"
#include "lib/texel.glsl"

uniform sampler2D face_planes;  // table of triangles, a texel each: the plane: its own unit normal n, and n·p

vec4 face_plane(int i)
{
    return texel_at(face_planes, table_texel(i));
}
