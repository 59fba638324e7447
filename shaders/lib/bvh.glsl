// The nearest triangle along a ray: a walk through scene/bvh.py's tree without a stack. With CUT_OUTS, some triangles are not there
// everywhere.
#include "lib/table.glsl"
#if CUT_OUTS
#include "generated/vertex_table.glsl"
#include "lib/cut_outs.glsl"
#endif

uniform usampler2D bvh_nodes;    // a texel a node, in rows of TABLE_COLUMNS: box and link, as Bvh.nodes has them
uniform sampler2D bvh_triangles; // three texels a triangle, leaf by leaf, in rows of TABLE_COLUMNS of them: a corner, its vertex's
                                 // number; the first one is -1 - that where the triangle is cut out
uniform int bvh_count;           // nodes of one octant
uniform vec3 bvh_start;          // metres: grid coordinate 0 of the boxes
uniform vec3 bvh_step;           // metres a step

struct Hit
{
    float t;      // metres along the unit direction; FARTHEST_HIT: nothing
    vec3 share;   // of the three corners, barycentric
    int triangle; // its place in the order of the leaves
};

const float FARTHEST_HIT = 1e30;

vec4 bvh_corner(int triangle, int corner)
{
    return texelFetch(bvh_triangles, table_texel(triangle, 3, corner), 0);
}

// The numbers of its vertices.
ivec3 bvh_vertices(int triangle)
{
    ivec3 numbers = ivec3(bvh_corner(triangle, 0).w, bvh_corner(triangle, 1).w, bvh_corner(triangle, 2).w);
#if CUT_OUTS
    if (numbers.x < 0) numbers.x = -1 - numbers.x;
#endif
    return numbers;
}

// The volumes that a ray spans with the three edges, whose corners are a, b and c from where it begins: both triangles at an edge
// find the same one, of opposite sign, so that no ray passes between them (Davis et al. 1997 call these Plucker coordinates).
vec3 bvh_volumes(vec3 d, vec3 a, vec3 b, vec3 c)
{
    return vec3(dot(d, cross(c - b, c + b)), dot(d, cross(a - c, a + c)), dot(d, cross(b - a, b + a)));
}

// The nearest hit of the ray from o in the unit direction d that is farther than `nearest` metres and less far than `farthest`;
// none: its t is `farthest`.
// Software renderers run what an `if` holds for all rays as soon as one has to, but a loop only as often as one needs it:
// so boxes are a loop of their own that ends at a leaf, and rays wait there for each other (Aila and Laine 2009).
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
            uvec4 n = texelFetch(bvh_nodes, table_texel(node), 0);
            vec3 t0 = (vec3(n.x & 0xFFFFu, n.x >> 16, n.y & 0xFFFFu) - from) * inverse;
            vec3 t1 = (vec3(n.y >> 16, n.z & 0xFFFFu, n.z >> 16) - from) * inverse;
            bool inside = max(max(t0.x, t0.y), max(t0.z, 0.0)) <= min(min(t1.x, t1.y), min(t1.z, hit.t));
            bool inner = int(n.w) >= 0;
            node = inside || !inner ? node + 1 : int(n.w);
            leaf = inside && !inner ? int(n.w) : 0;
        }
        int triangle = (leaf & 0x7FFFFFFF) >> 2, last = leaf == 0 ? -1 : triangle + (leaf & 3);
        while (triangle <= last)
        {
            vec3 a = bvh_corner(triangle, 0).xyz - o, b = bvh_corner(triangle, 1).xyz - o, c = bvh_corner(triangle, 2).xyz - o;
            vec3 share = bvh_volumes(d, a, b, c);
            vec3 n = cross(b - a, c - a);
            float t = dot(n, a) / dot(n, d);
            bool through = min(share.x, min(share.y, share.z)) >= 0.0 || max(share.x, max(share.y, share.z)) <= 0.0;
#if CUT_OUTS
            through = through && t > nearest && t < hit.t;
            bool undecided = through && bvh_corner(triangle, 0).w < 0.0;
            while (undecided)  // a loop, as above
            {
                ivec3 i = bvh_vertices(triangle);
                vec3 weights = share / (share.x + share.y + share.z);
                through = !light_passes(interpolate(weights, vertex_at(i.x), vertex_at(i.y), vertex_at(i.z)));
                undecided = false;
            }
#endif
            if (through && t > nearest && t < hit.t) hit = Hit(t, share, triangle);
            ++triangle;
        }
    }
    hit.share /= hit.share.x + hit.share.y + hit.share.z;
    return hit;
}

// The same however far.
Hit bvh_closest(vec3 o, vec3 d, float nearest)
{
    return bvh_between(o, d, nearest, FARTHEST_HIT);
}

// The nearest hit, where it is known already which triangle a ray hits first; -1: none. The hit is on the triangle, even where
// rounding has the ray pass beside it. Where that is cut out there, the ray goes through the tree after all.
Hit bvh_known(vec3 o, vec3 d, int triangle)
{
    if (triangle < 0) return Hit(FARTHEST_HIT, vec3(1.0, 0.0, 0.0), 0);
    vec3 a = bvh_corner(triangle, 0).xyz - o, b = bvh_corner(triangle, 1).xyz - o, c = bvh_corner(triangle, 2).xyz - o;
    vec3 share = bvh_volumes(d, a, b, c);
    share = max(share.x + share.y + share.z < 0.0 ? -share : share, 0.0);
    float sum = share.x + share.y + share.z;
    share = sum > 0.0 ? share / sum : vec3(1.0 / 3.0);
    Hit hit = Hit(max(dot(d, a * share.x + b * share.y + c * share.z), 1e-30), share, triangle);
#if CUT_OUTS
    bool undecided = bvh_corner(triangle, 0).w < 0.0;
    while (undecided)  // a loop, as above
    {
        ivec3 i = bvh_vertices(triangle);
        if (light_passes(interpolate(share, vertex_at(i.x), vertex_at(i.y), vertex_at(i.z)))) hit = bvh_closest(o, d, 0.0);
        undecided = false;
    }
#endif
    return hit;
}

// Whether nothing stands between two points.
bool bvh_free(vec3 a, vec3 b)
{
    float far = length(b - a);
    return far == 0.0 || bvh_between(a, (b - a) / far, 0.0, far).t >= far;
}

// Whether nothing stands between the eye and what lies `away` from it, at the distance r. Where it is not `possible` that light
// comes from there, or that is where the eye is (as with records that an atlas has no more of), no ray is sent.
bool bvh_way_free(vec3 eye, vec3 away, float r, bool possible)
{
    float far = possible && r > 0.0 ? r * (1.0 - SHORT) : -1.0;  // then no box is entered, wherever the eye is
    return bvh_between(eye, away / r, 0.0, far).t >= far && possible;
}
