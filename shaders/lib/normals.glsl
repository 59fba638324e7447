// Surfaces are two-sided: normals are turned to whoever looks.

// The interpolated normal, unit, on the same side of the surface as the geometric normal g.
vec3 shading_normal(vec3 n, vec3 g)
{
    float size = length(n);
    n = size > 0.0 ? n / size : g;
    return dot(n, g) < 0.0 ? -n : n;
}
