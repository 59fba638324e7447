// Surfaces are two-sided: normals are turned to the side they are seen from.

// The interpolated normal n made unit and turned to the side of the surface that the geometric normal g points to.
vec3 shading_normal(vec3 n, vec3 g)
{
    float size = length(n);
    n = size > 0.0 ? n / size : g;
    return dot(n, g) < 0.0 ? -n : n;
}

// A unit vector at right angles to the unit vector n.
vec3 perpendicular(vec3 n)
{
    return normalize(abs(n.y) < 0.9 ? cross(vec3(0.0, 1.0, 0.0), n) : cross(vec3(1.0, 0.0, 0.0), n));
}
