// Surfaces are two-sided: normals are turned to the side they are seen from.

// The interpolated normal n made unit and turned to the side of the surface that the geometric normal g points to.
vec3 shading_normal(vec3 n, vec3 g)
{
    float size = length(n);
    n = size > 0.0 ? n / size : g;
    return dot(n, g) < 0.0 ? -n : n;
}
