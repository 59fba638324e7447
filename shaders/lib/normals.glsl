// Unit normals. Surfaces are two-sided: normals are turned to the side they are seen from.

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

// A unit vector in two numbers in -1..1: the octahedral map (Meyer et al. 2010, "On Floating-Point Normal Vectors").
vec2 octahedral_encode(vec3 v)
{
    v /= abs(v.x) + abs(v.y) + abs(v.z);
    vec2 folded = (1.0 - abs(v.yx)) * vec2(v.x >= 0.0 ? 1.0 : -1.0, v.y >= 0.0 ? 1.0 : -1.0);
    return v.z >= 0.0 ? v.xy : folded;
}

vec3 octahedral_decode(vec2 e)
{
    vec3 v = vec3(e, 1.0 - abs(e.x) - abs(e.y));
    vec2 folded = (1.0 - abs(v.yx)) * vec2(v.x >= 0.0 ? 1.0 : -1.0, v.y >= 0.0 ? 1.0 : -1.0);
    if (v.z < 0.0) v.xy = folded;
    return normalize(v);
}
