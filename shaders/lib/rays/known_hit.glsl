// What a ray hits, where somebody else has traced it.
#include "lib/rays/hit.glsl"
#if CUT_OUTS
#include "lib/rays/bvh.glsl"
#endif

// Nearest hit of a ray whose first triangle is known; -1: none. The hit is on the triangle, even if rounding makes the ray miss
// it. If the triangle is cut out there, the ray traverses the tree.
Hit known_hit(vec3 o, vec3 d, int triangle)
{
    if (triangle < 0) return Hit(FARTHEST_HIT, vec3(1.0, 0.0, 0.0), 0);
    vec3 a = triangle_point(triangle, 0) - o, b = triangle_point(triangle, 1) - o, c = triangle_point(triangle, 2) - o;
    vec3 share = hit_volumes(d, a, b, c);
    share = max(share.x + share.y + share.z < 0.0 ? -share : share, 0.0);
    float sum = share.x + share.y + share.z;
    share = sum > 0.0 ? share / sum : vec3(1.0 / 3.0);
    Hit hit = Hit(max(dot(d, a * share.x + b * share.y + c * share.z), 1e-30), share, triangle);
#if CUT_OUTS
    bool undecided = triangle_corner(triangle, 0).w < 0.0;
    while (undecided)  // a loop, as above
    {
        ivec3 i = triangle_vertices(triangle);
        if (light_passes(interpolate(share, vertex_at(i.x), vertex_at(i.y), vertex_at(i.z)))) hit = bvh_closest(o, d, 0.0);
        undecided = false;
    }
#endif
    return hit;
}
