// The weight of emission at a ray's hit, because next-event estimation also samples emitters (METHOD.md, 3.8).
#include "lighting/emitters.glsl"

uniform sampler2D emitter_numbers;  // per triangle: density per sample in its cluster, m⁻² (0: no emitter); cluster

// Return the weight of the balance heuristic (Veach and Guibas 1995) for a ray in the direction d that hits a triangle with
// normal g at distance t. rays: rays per steradian.
float emission_weight(int triangle, vec3 eye, vec3 d, float t, vec3 g, float rays)
{
    vec2 emitter = texel_at(emitter_numbers, table_texel(triangle)).rg;
    // a loop in place of an `if`, because software renderers run an `if` for all rays
    int clusters = emitter.x > 0.0 ? emitter_cluster_count : 0;
    float all_clusters = 0.0;
    for (int i = 0; i < clusters; ++i) all_clusters += cluster_importance(i, eye);
    if (clusters == 0) return 1.0;
    float samples = WORTH * emitter_samples * emitter.x * cluster_importance(int(emitter.y), eye) / all_clusters;  // m⁻²
    float cosine = abs(dot(g, d));
    return rays * cosine / max(rays * cosine + samples * t * t, 1e-30);
}
