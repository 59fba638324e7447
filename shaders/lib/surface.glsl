// Which way a surface faces: surfaces are two-sided, so both normals are turned to whoever looks.

uniform sampler2D face_planes;  // texel i, in rows of 1024, is triangle i's plane: its own unit normal n, and n·p

vec4 face_plane(int i)
{
    return texelFetch(face_planes, ivec2(i & 1023, i >> 10), 0);
}

// The interpolated normal, unit, on the same side of the surface as the geometric normal g.
vec3 shading_normal(vec3 n, vec3 g)
{
    float size = length(n);
    n = size > 0.0 ? n / size : g;
    return dot(n, g) < 0.0 ? -n : n;
}
