// Where a ray meets a triangle.
#include "lib/rays/triangles.glsl"

struct Hit
{
    float t;      // metres along the unit direction; FARTHEST_HIT: nothing
    vec3 share;   // of the three corners, barycentric
    int triangle; // its number in the scene
};

const float FARTHEST_HIT = 1e30;

// The volumes that a ray spans with the three edges, whose corners are a, b and c from where it begins: both triangles at an edge
// find the same one, of opposite sign, so that no ray passes between them (Davis et al. 1997 call these Plucker coordinates).
vec3 hit_volumes(vec3 d, vec3 a, vec3 b, vec3 c)
{
    return vec3(dot(d, cross(c - b, c + b)), dot(d, cross(a - c, a + c)), dot(d, cross(b - a, b + a)));
}
