// Whether two points lie on one surface, as far as their unit normals n and m can tell.
const float ASIDE = 0.25;  // of their distance, by which one may lie off the other's tangent plane
const float ALIKE = 0.8;   // cosine of the angle between the normals

bool alike(vec3 p, vec3 n, vec3 q, vec3 m)
{
    return dot(n, m) >= ALIKE && abs(dot(q - p, n + m)) * 0.5 <= ASIDE * distance(p, q);
}
