// Whether two points lie on one surface, judged by their places and unit normals.
const float SAME_SURFACE_COSINE = 0.8;  // least cosine of the angle between the normals
const float SAME_SURFACE_RISE = 0.25;   // how far one may lie off the other's tangent plane, as a share of their distance

// One number for a unit normal, different for the six sides of a box and for nearly all normals that differ much.
float facing_of(vec3 n)
{
    return dot(n, vec3(0.9, 0.5, 0.2));
}

bool same_surface(vec3 p, vec3 n, vec3 q, vec3 m)
{
    return dot(n, m) >= SAME_SURFACE_COSINE && abs(dot(q - p, n + m)) * 0.5 <= SAME_SURFACE_RISE * distance(p, q);
}
