// Sampling of emissive triangles for next-event estimation (METHOD.md, 3.8): choice of a triangle, and radiance of its points.
#include "lighting/emitters.glsl"
#include "generated/vertex_table.glsl"
#include "lib/material_table.glsl"
#include "lib/rays/triangles.glsl"
#if CUT_OUTS
#include "lib/rays/cut_outs.glsl"
#endif

uniform sampler2D emitter_triangles;  // per emissive triangle: number in the scene, cumulative share of the cluster's power,
                                      // density per sample in the cluster, m⁻², and 1 if only the front is visible

// A chosen emissive triangle.
struct Emitter
{
    int triangle;      // number in the scene
    float density;     // density per sample in the cluster, m⁻²
    float importance;  // importance of the cluster
    bool one_sided;
    float rest;        // remainder of the random number, 0..1
};

// Return the sum of the importances of all clusters.
float all_importance(vec3 eye)
{
    float sum = 0.0;
    for (int i = 0; i < emitter_cluster_count; ++i) sum += cluster_importance(i, eye);
    return sum;
}

// Return the emitter for u: a random number in 0..1, times the sum of all importances.
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
    vec4 cluster_row = emitter_clusters[2 * cluster + 1];
    int low = int(cluster_row.y), first = low, high = low + int(cluster_row.z) - 1;  // the first with a share of at least u
    while (low < high)
    {
        int middle = (low + high) >> 1;
        bool less = texel_at(emitter_triangles, table_texel(middle)).y < u;
        low = less ? middle + 1 : low;
        high = less ? high : middle;
    }
    vec4 chosen = texel_at(emitter_triangles, table_texel(low));
    float previous = low > first ? texel_at(emitter_triangles, table_texel(low - 1)).y : 0.0;
    float rest = clamp((u - previous) / max(chosen.y - previous, 1e-20), 0.0, 1.0);
    return Emitter(int(chosen.x), chosen.z, importance, chosen.w > 0.5, rest);
}

// Return barycentric coordinates that are uniform on a triangle if u and v are uniform on the unit square.
vec3 uniform_point(float u, float v)
{
    u = sqrt(u);
    return vec3(1.0 - u, u * (1.0 - v), u * v);
}

// Return the emitted radiance at a point of a triangle, as a mean over `area` m²; 0 in a hole.
vec3 emitter_radiance(int triangle, vec3 barycentric, float area)
{
    ivec3 number = triangle_vertices(triangle);
    Vertex A = vertex_at(number.x), B = vertex_at(number.y), C = vertex_at(number.z), point = interpolate(barycentric, A, B, C);
#if CUT_OUTS
    if (triangle_corner(triangle, 0).w < 0.0 && light_passes(point)) return vec3(0.0);
#endif
    return material_mean(point, texture_area(area, A, B, C)).emission;
}
