// The planes of triangles, by triangle number.
#include "lib/normals.glsl"
#include "lib/table.glsl"
#include "lib/texel.glsl"

uniform sampler2D face_planes;  // one texel per triangle: unit normal n of the front, and n·p of any point p, metres

// Return the plane of triangle i.
vec4 face_plane(int i)
{
    return texel_at(face_planes, table_texel(i));
}
