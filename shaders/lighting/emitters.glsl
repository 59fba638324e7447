// Emissive triangles as area lights: density and positions of next-event samples for a receiver.
// The tables come from irrsplat/lighting/emitter_table.py. A cluster of triangles is drawn by its power over the square of its
// distance, and a triangle in it by power: luminance times area.
#include "generated/constants.glsl"
#include "lib/table.glsl"

uniform vec4 emitter_clusters[2 * MAX_EMITTER_CLUSTERS];  // centre, radius²; power, its first triangle in the list, their number
uniform int emitter_cluster_count;
uniform float emitter_samples;  // of each record

// The power of cluster i over the square of its distance from p; in the cluster's ball, of the ball's radius.
float cluster_importance(int i, vec3 p)
{
    vec4 ball = emitter_clusters[2 * i];
    vec3 away = ball.xyz - p;
    return emitter_clusters[2 * i + 1].x / max(dot(away, away), ball.w);
}
