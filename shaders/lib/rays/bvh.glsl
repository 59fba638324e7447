// The nearest triangle along a ray: a walk without a stack through the tree of scene/spatial/bvh.py. With CUT_OUTS, some triangles
// have holes.
#include "lib/rays/hit.glsl"
#if CUT_OUTS
#include "generated/vertex_table.glsl"
#include "lib/rays/cut_outs.glsl"
#endif

uniform usampler2D bvh_nodes;    // a texel a node, in rows of TABLE_COLUMNS: box and link, see Bvh.nodes
uniform isampler2D bvh_leaves;   // a texel each: the triangles' numbers, leaf by leaf
uniform int bvh_count;           // nodes of one octant
uniform vec3 bvh_start;          // metres: grid coordinate 0 of the boxes
uniform vec3 bvh_step;           // metres a step

// The nearest hit of the ray from o in the unit direction d that is farther than `nearest` metres and less far than `farthest`;
// none: its t is `farthest`.
// A software renderer runs both branches of an `if` for a group of rays, but a loop only as often as the longest ray needs. So
// boxes have a loop of their own that ends at a leaf, where rays wait for each other (Aila and Laine 2009).
Hit bvh_between(vec3 o, vec3 d, float nearest, float farthest)
{
    Hit hit = Hit(farthest, vec3(0.0), 0);
    vec3 inverse = bvh_step / mix(d, vec3(1e-20), lessThan(abs(d), vec3(1e-20)));
    vec3 from = (o - bvh_start) / bvh_step;
    int octant = (d.x < 0.0 ? 1 : 0) + (d.y < 0.0 ? 2 : 0) + (d.z < 0.0 ? 4 : 0);
    int node = octant * bvh_count, end = node + bvh_count;
    while (node < end)
    {
        int leaf = 0;
        while (leaf == 0 && node < end)
        {
            uvec4 n = texel_at(bvh_nodes, table_texel(node));
            vec3 t0 = (vec3(n.x & 0xFFFFu, n.x >> 16, n.y & 0xFFFFu) - from) * inverse;
            vec3 t1 = (vec3(n.y >> 16, n.z & 0xFFFFu, n.z >> 16) - from) * inverse;
            bool inside = max(max(t0.x, t0.y), max(t0.z, 0.0)) <= min(min(t1.x, t1.y), min(t1.z, hit.t));
            bool inner = int(n.w) >= 0;
            node = inside || !inner ? node + 1 : int(n.w);
            leaf = inside && !inner ? int(n.w) : 0;
        }
        int item = (leaf & 0x7FFFFFFF) >> 2, last = leaf == 0 ? -1 : item + (leaf & 3);
        while (item <= last)
        {
            int triangle = texel_at(bvh_leaves, table_texel(item)).r;
            vec3 a = triangle_point(triangle, 0) - o, b = triangle_point(triangle, 1) - o, c = triangle_point(triangle, 2) - o;
            vec3 share = hit_volumes(d, a, b, c);
            vec3 n = cross(b - a, c - a);
            float t = dot(n, a) / dot(n, d);
            bool through = min(share.x, min(share.y, share.z)) >= 0.0 || max(share.x, max(share.y, share.z)) <= 0.0;
#if CUT_OUTS
            through = through && t > nearest && t < hit.t;
            bool undecided = through && triangle_corner(triangle, 0).w < 0.0;
            while (undecided)  // a loop, as above
            {
                ivec3 i = triangle_vertices(triangle);
                vec3 weights = share / (share.x + share.y + share.z);
                through = !light_passes(interpolate(weights, vertex_at(i.x), vertex_at(i.y), vertex_at(i.z)));
                undecided = false;
            }
#endif
            if (through && t > nearest && t < hit.t) hit = Hit(t, share, triangle);
            ++item;
        }
    }
    hit.share /= hit.share.x + hit.share.y + hit.share.z;
    return hit;
}

// True if the segment from the eye to the point `away` from it, at the distance r, is free. No ray is traced unless light from
// there is `possible`, nor for r = 0 (unused cells of an atlas).
bool bvh_way_free(vec3 eye, vec3 away, float r, bool possible)
{
    float far = possible && r > 0.0 ? r * (1.0 - SHORT) : -1.0;  // then no box is entered, wherever the eye is
    return bvh_between(eye, away / r, 0.0, far).t >= far && possible;
}
