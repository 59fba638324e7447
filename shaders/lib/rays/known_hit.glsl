// The point where a ray hits the triangle that Embree found.
#include "lib/rays/hit.glsl"

// Return the hit of the ray from o in the unit direction d on its first triangle; -1: no hit. The hit lies on the triangle, even
// if rounding makes the ray miss the triangle.
Hit known_hit(vec3 o, vec3 d, int triangle)
{
    bool none = triangle < 0;
    triangle = max(triangle, 0);  // no `return`, so that the compiler reads the corners once for this function and its caller
    vec3 a = triangle_point(triangle, 0) - o, b = triangle_point(triangle, 1) - o, c = triangle_point(triangle, 2) - o;
    vec3 volumes = hit_volumes(d, a, b, c);
    volumes = max(volumes.x + volumes.y + volumes.z < 0.0 ? -volumes : volumes, 0.0);
    float sum = volumes.x + volumes.y + volumes.z;
    vec3 barycentric = sum > 0.0 ? volumes / sum : vec3(1.0 / 3.0);
    float t = max(dot(d, a * barycentric.x + b * barycentric.y + c * barycentric.z), 1e-30);
    return Hit(none ? FARTHEST_HIT : t, barycentric, triangle);
}
