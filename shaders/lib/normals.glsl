// Unit normals. Surfaces are two-sided, so normals are turned to the side of the viewer.

// Return the interpolated normal n, normalised and turned to the side of the unit geometric normal g; g if n is 0.
vec3 shading_normal(vec3 n, vec3 g)
{
    float size = length(n);
    n = size > 0.0 ? n / size : g;
    return dot(n, g) < 0.0 ? -n : n;
}

// Return a unit vector perpendicular to the unit vector n.
vec3 perpendicular(vec3 n)
{
    return normalize(abs(n.y) < 0.9 ? cross(vec3(0.0, 1.0, 0.0), n) : cross(vec3(1.0, 0.0, 0.0), n));
}

// Return the octahedral coordinates, -1..1, of a unit vector (Meyer et al. 2010, "On Floating-Point Normal Vectors").
vec2 octahedral_encode(vec3 v)
{
    v /= abs(v.x) + abs(v.y) + abs(v.z);
    vec2 folded = (1.0 - abs(v.yx)) * vec2(v.x >= 0.0 ? 1.0 : -1.0, v.y >= 0.0 ? 1.0 : -1.0);
    return v.z >= 0.0 ? v.xy : folded;
}

// Return the unit vector of octahedral coordinates.
vec3 octahedral_decode(vec2 e)
{
    vec3 v = vec3(e, 1.0 - abs(e.x) - abs(e.y));
    vec2 folded = (1.0 - abs(v.yx)) * vec2(v.x >= 0.0 ? 1.0 : -1.0, v.y >= 0.0 ? 1.0 : -1.0);
    if (v.z < 0.0) v.xy = folded;
    return normalize(v);
}
