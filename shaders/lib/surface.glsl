// Which way a surface faces.
#include "lib/normals.glsl"

uniform sampler2D face_planes;  // texel i, in rows of 1024, is triangle i's plane: its own unit normal n, and n·p

vec4 face_plane(int i)
{
    return texelFetch(face_planes, ivec2(i & 1023, i >> 10), 0);
}
