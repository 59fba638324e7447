// The hit of a ray that Embree has traced.
#include "lib/rays/hit.glsl"

// Nearest hit of a ray whose first triangle is known; -1: none. The hit is on the triangle, even if rounding makes the ray miss it.
Hit known_hit(vec3 o, vec3 d, int triangle)
{
    bool none = triangle < 0;
    triangle = max(triangle, 0);  // no `return`, so that the compiler reads the corners once for this function and its caller
    vec3 a = triangle_point(triangle, 0) - o, b = triangle_point(triangle, 1) - o, c = triangle_point(triangle, 2) - o;
    vec3 share = hit_volumes(d, a, b, c);
    share = max(share.x + share.y + share.z < 0.0 ? -share : share, 0.0);
    float sum = share.x + share.y + share.z;
    share = sum > 0.0 ? share / sum : vec3(1.0 / 3.0);
    float t = max(dot(d, a * share.x + b * share.y + c * share.z), 1e-30);
    return Hit(none ? FARTHEST_HIT : t, share, triangle);
}
