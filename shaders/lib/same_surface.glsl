// A test of two points: their positions and unit normals decide if they lie on one surface (METHOD.md, 8.1).
const float SAME_SURFACE_COSINE = 0.8;  // least cosine of the angle between the normals
const float SAME_SURFACE_RISE = 0.25;   // greatest distance from the mean tangent plane, as a share of the distance of the points
const float OTHER_SURFACE = 1e-4;       // weight of points on other surfaces: they count only without a point on this surface

// Return a number for a unit normal. It differs between the six sides of a box, and for most pairs of very different normals.
float facing_of(vec3 n)
{
    return dot(n, vec3(0.9, 0.5, 0.2));
}

// Return true if p with normal n and q with normal m lie on one surface.
bool same_surface(vec3 p, vec3 n, vec3 q, vec3 m)
{
    return dot(n, m) >= SAME_SURFACE_COSINE && abs(dot(q - p, n + m)) * 0.5 <= SAME_SURFACE_RISE * distance(p, q);
}

// Return the weight of a sample at q with normal m, at a distance of d samples on screen, in the light of p with normal n: joint
// bilateral upsampling (Kopf et al. 2007).
float bilateral_weight(vec3 p, vec3 n, vec3 q, vec3 m, float d)
{
    return exp2(-2.0 * d * d) * (same_surface(p, n, q, m) ? 1.0 : OTHER_SURFACE * pow(max(dot(n, m), 0.01), 4.0));
}
