// The share of the emission at a ray's hit that counts, since next-event estimation samples emitters, too.
#include "lighting/emitters.glsl"

uniform sampler2D emitter_numbers;  // a texel a triangle: the density of samples among those of its cluster, m⁻² (0: no light); the cluster

// The balance heuristic (Veach and Guibas 1995): of rays of so many a steradian in the direction d, which meets the triangle with
// normal g at distance t.
float ray_share(int triangle, vec3 eye, vec3 d, float t, vec3 g, float rays)
{
    vec2 found = texel_at(emitter_numbers, table_texel(triangle)).rg;
    // a loop, since software renderers run it only where a ray needs it
    int clusters = found.x > 0.0 ? emitter_cluster_count : 0;
    float all_of_them = 0.0;
    for (int i = 0; i < clusters; ++i) all_of_them += cluster_importance(i, eye);
    if (clusters == 0) return 1.0;
    float samples = WORTH * emitter_samples * found.x * cluster_importance(int(found.y), eye) / all_of_them;  // m⁻²
    float cosine = abs(dot(g, d));
    return rays * cosine / max(rays * cosine + samples * t * t, 1e-30);
}
