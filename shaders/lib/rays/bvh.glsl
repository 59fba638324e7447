// The nearest triangle along a ray, by stackless traversal of the bounding volume hierarchy of irrsplat/scene/spatial/bvh.py
// (METHOD.md, 12). CUT_OUTS: 1 if some triangles have holes.
#include "lib/rays/hit.glsl"
#if CUT_OUTS
#include "generated/vertex_table.glsl"
#include "lib/rays/cut_outs.glsl"
#endif

uniform usampler2D bvh_nodes;    // one texel per node, in rows of TABLE_COLUMNS: box and link, see Bvh.nodes
uniform isampler2D bvh_leaves;   // one texel per triangle: its number, leaf by leaf
uniform int bvh_count;           // nodes per octant of ray directions; in each octant, the nearer child is first
uniform vec3 bvh_start;          // world position of grid coordinate 0 of the boxes, metres
uniform vec3 bvh_step;           // metres per step of the grid

// Return the nearest hit of the ray from o in the unit direction d between `nearest` and `farthest` metres; t is `farthest`
// without a hit. A software renderer runs both branches of an `if` for a group of rays, but a loop only as often as the longest
// ray needs. The inner loop therefore visits boxes only, and ends at a leaf, where rays wait for each other (Aila and Laine
// 2009).
Hit bvh_between(vec3 o, vec3 d, float nearest, float farthest)
{
    Hit hit = Hit(farthest, vec3(0.0), 0);
    vec3 inverse = bvh_step / mix(d, vec3(1e-20), lessThan(abs(d), vec3(1e-20)));
    vec3 origin = (o - bvh_start) / bvh_step;
    int octant = (d.x < 0.0 ? 1 : 0) + (d.y < 0.0 ? 2 : 0) + (d.z < 0.0 ? 4 : 0);
    int node = octant * bvh_count, end = node + bvh_count;
    while (node < end)
    {
        int leaf = 0;
        while (leaf == 0 && node < end)
        {
            uvec4 n = texel_at(bvh_nodes, table_texel(node));
            vec3 t0 = (vec3(n.x & 0xFFFFu, n.x >> 16, n.y & 0xFFFFu) - origin) * inverse;
            vec3 t1 = (vec3(n.y >> 16, n.z & 0xFFFFu, n.z >> 16) - origin) * inverse;
            bool enters = max(max(t0.x, t0.y), max(t0.z, 0.0)) <= min(min(t1.x, t1.y), min(t1.z, hit.t));
            bool inner = int(n.w) >= 0;
            node = enters || !inner ? node + 1 : int(n.w);
            leaf = enters && !inner ? int(n.w) : 0;
        }
        int item = (leaf & 0x7FFFFFFF) >> 2, last = leaf == 0 ? -1 : item + (leaf & 3);
        while (item <= last)
        {
            int triangle = texel_at(bvh_leaves, table_texel(item)).r;
            vec3 a = triangle_point(triangle, 0) - o, b = triangle_point(triangle, 1) - o, c = triangle_point(triangle, 2) - o;
            vec3 volumes = hit_volumes(d, a, b, c);
            vec3 n = cross(b - a, c - a);
            float t = dot(n, a) / dot(n, d);
            bool through = min(volumes.x, min(volumes.y, volumes.z)) >= 0.0 || max(volumes.x, max(volumes.y, volumes.z)) <= 0.0;
#if CUT_OUTS
            through = through && t > nearest && t < hit.t;
            bool undecided = through && triangle_corner(triangle, 0).w < 0.0;
            while (undecided)  // a loop in place of an `if`, as above
            {
                ivec3 i = triangle_vertices(triangle);
                vec3 weights = volumes / (volumes.x + volumes.y + volumes.z);
                through = !light_passes(interpolate(weights, vertex_at(i.x), vertex_at(i.y), vertex_at(i.z)));
                undecided = false;
            }
#endif
            if (through && t > nearest && t < hit.t) hit = Hit(t, volumes, triangle);
            ++item;
        }
    }
    hit.barycentric /= hit.barycentric.x + hit.barycentric.y + hit.barycentric.z;
    return hit;
}

// Return true if no triangle blocks the segment from the eye along `to_point`, r metres long. No ray is traced unless `possible`,
// or if r is 0 (unused cells of an atlas).
bool bvh_segment_free(vec3 eye, vec3 to_point, float r, bool possible)
{
    float end = possible && r > 0.0 ? r * (1.0 - SHORT) : -1.0;  // -1: the ray enters no box, wherever the eye is
    return bvh_between(eye, to_point / r, 0.0, end).t >= end && possible;
}
