// Which way a surface faces: surfaces are two-sided, so both normals are turned to whoever looks.

uniform sampler2D face_normals;  // texel i, in rows of 1024, is triangle i's own unit normal

// The normal of triangle `i`, turned from the surface at p to `viewer`. (Screen-space derivatives of p would be too coarse:
// the shadow test extends the plane.)
vec3 geometric_normal(vec3 p, vec3 viewer, int i)
{
    vec3 g = texelFetch(face_normals, ivec2(i & 1023, i >> 10), 0).xyz;
    return dot(g, viewer - p) < 0.0 ? -g : g;
}

// The interpolated normal, unit, on the same side of the surface as the geometric normal g.
vec3 shading_normal(vec3 n, vec3 g)
{
    float size = length(n);
    n = size > 0.0 ? n / size : g;
    return dot(n, g) < 0.0 ? -n : n;
}
