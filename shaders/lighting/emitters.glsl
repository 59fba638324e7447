// Clusters of emissive triangles for next-event estimation (METHOD.md, 3.8), from irrsplat/lighting/emitter_table.py. A cluster
// is chosen by importance, and a triangle in it by power: luminance times area.
#include "generated/constants.glsl"
#include "lib/table.glsl"

uniform vec4 emitter_clusters[2 * MAX_EMITTER_CLUSTERS];  // centre, radius²; power, first triangle, number of triangles
uniform int emitter_cluster_count;
uniform float emitter_samples;  // samples per record

// Return the importance of cluster i at p: its power over the squared distance, which is at least the squared radius.
float cluster_importance(int i, vec3 p)
{
    vec4 ball = emitter_clusters[2 * i];
    vec3 away = ball.xyz - p;
    return emitter_clusters[2 * i + 1].x / max(dot(away, away), ball.w);
}
