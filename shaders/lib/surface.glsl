// Which way a surface faces: surfaces are two-sided, so both normals are turned to whoever looks.

// The triangle's own normal at world position p, turned to `viewer`; screen-space derivatives of p span its plane.
vec3 geometric_normal(vec3 p, vec3 viewer, vec3 fallback)
{
    vec3 g = cross(dFdx(p), dFdy(p));
    float size = length(g);
    g = size > 0.0 ? g / size : fallback;
    return dot(g, viewer - p) < 0.0 ? -g : g;
}

// The interpolated normal, unit, on the same side of the surface as the geometric normal g.
vec3 shading_normal(vec3 n, vec3 g)
{
    float size = length(n);
    n = size > 0.0 ? n / size : g;
    return dot(n, g) < 0.0 ? -n : n;
}
