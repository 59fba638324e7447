// Unit vectors in two numbers in -1..1: the octahedral map (Meyer et al. 2010, "On Floating-Point Normal Vectors").
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
