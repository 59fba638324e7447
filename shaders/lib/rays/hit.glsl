// The intersection of a ray with a triangle.
#include "lib/rays/triangles.glsl"

struct Hit
{
    float t;           // distance along the unit direction, metres; FARTHEST_HIT: no hit
    vec3 barycentric;  // coordinates on the triangle
    int triangle;      // number in the scene
};

const float FARTHEST_HIT = 1e30;  // metres

// Return the signed volumes between a ray of direction d and the edges of a triangle; a, b, c: its corners relative to the ray's
// origin. The two triangles at an edge compute equal volumes of opposite sign, so that no ray passes between them (watertight;
// Plücker coordinates, Davis et al. 1997).
vec3 hit_volumes(vec3 d, vec3 a, vec3 b, vec3 c)
{
    return vec3(dot(d, cross(c - b, c + b)), dot(d, cross(a - c, a + c)), dot(d, cross(b - a, b + a)));
}
