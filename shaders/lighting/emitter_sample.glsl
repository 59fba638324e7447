// Points of emitters for next-event samples: the triangle of a random number, the radiance of a point of it, and its visibility.
#include "lighting/emitters.glsl"
#include "generated/vertex_table.glsl"
#include "lib/material_table.glsl"
#include "lib/rays/triangles.glsl"
#if CUT_OUTS
#include "lib/rays/cut_outs.glsl"
#endif

uniform sampler2D emitter_triangles;  // a texel each: its number, the share of its cluster's power up to it, the density
                                      // of samples in the cluster, m⁻², and 1 if only its front can be seen

struct Emitter
{
    int triangle;      // its number in the scene
    float density;     // of the samples that its cluster gets, m⁻²
    float importance;  // of its cluster
    bool one_sided;
    float rest;        // unused part of the random number, 0..1
};

// The sum of all clusters' importances.
float all_importance(vec3 eye)
{
    float sum = 0.0;
    for (int i = 0; i < emitter_cluster_count; ++i) sum += cluster_importance(i, eye);
    return sum;
}

// The emitter that a random number stands for: u of 0..1, times the sum of all importances.
Emitter choose_emitter(float u, vec3 eye)
{
    int cluster = 0;
    float importance = cluster_importance(0, eye);
    while (u > importance && cluster < emitter_cluster_count - 1)
    {
        u -= importance;
        importance = cluster_importance(++cluster, eye);
    }
    u = clamp(u / importance, 0.0, 1.0);
    vec4 about = emitter_clusters[2 * cluster + 1];
    int low = int(about.y), first = low, high = low + int(about.z) - 1;  // the first whose share is no less than u
    while (low < high)
    {
        int middle = (low + high) >> 1;
        bool less = texel_at(emitter_triangles, table_texel(middle)).y < u;
        low = less ? middle + 1 : low;
        high = less ? high : middle;
    }
    vec4 chosen = texel_at(emitter_triangles, table_texel(low));
    float before = low > first ? texel_at(emitter_triangles, table_texel(low - 1)).y : 0.0;
    float rest = clamp((u - before) / max(chosen.y - before, 1e-20), 0.0, 1.0);
    return Emitter(int(chosen.x), chosen.z, importance, chosen.w > 0.5, rest);
}

// A point that is spread evenly over a triangle where u and v are evenly spread over the unit square: its shares of the corners.
vec3 uniform_point(float u, float v)
{
    u = sqrt(u);
    return vec3(1.0 - u, u * (1.0 - v), u * v);
}

// The radiance of the triangle at that point, a mean over so many m² about it; none where it is cut out.
vec3 emitter_radiance(int triangle, vec3 share, float area)
{
    ivec3 number = triangle_vertices(triangle);
    Vertex A = vertex_at(number.x), B = vertex_at(number.y), C = vertex_at(number.z), point = interpolate(share, A, B, C);
#if CUT_OUTS
    if (triangle_corner(triangle, 0).w < 0.0 && light_passes(point)) return vec3(0.0);
#endif
    return material_mean(point, texture_area(area, A, B, C)).emission;
}
