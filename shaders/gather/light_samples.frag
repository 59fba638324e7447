// What light samples add to the sums of a block of a record: points of emitters, seen by shadow rays. Each counts by the balance
// heuristic, so that what rays find by chance (emitters_hit.glsl) and these together are all that emitters bring.
#include "lighting/emitters.glsl"
#include "generated/vertex_table.glsl"
#include "lib/material_table.glsl"
#include "lib/bvh.glsl"
#include "gather/ray_density.glsl"

uniform sampler2D emitter_triangles;  // a texel each: its number in the tree, the share of its cluster's power up to it, the density
                                      // of samples in the cluster, m⁻², and 1 if only its front can be seen
uniform sampler2D frames;             // texels (i, 0..3) as in reduce_blocks.frag, w of 0 and 1: two random numbers, (i, 4): the eye
uniform ivec2 blocks;                 // of a cell
uniform int columns;                  // cells per row

layout(location = 0) out vec4 out_sums;
layout(location = 1) out vec2 out_share;
#if GRADIENTS
layout(location = 2) out vec4 out_m_r;
layout(location = 3) out vec4 out_m_g;
layout(location = 4) out vec4 out_m_b;
layout(location = 5) out vec4 out_g_r;
layout(location = 6) out vec4 out_g_g;
layout(location = 7) out vec4 out_g_b;
#endif

const float GOLDEN = 0.61803399;
const float SHORT = 1e-4;  // of the way, by which a shadow ray ends before the emitter

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), place = at / blocks, inside = at - place * blocks;
    int record = place.y * columns + place.x;
    vec4 tangent = texelFetch(frames, ivec2(record, 0), 0), bitangent = texelFetch(frames, ivec2(record, 1), 0);
    mat3 frame = mat3(tangent.xyz, bitangent.xyz, texelFetch(frames, ivec2(record, 2), 0).xyz);
    vec3 g = texelFetch(frames, ivec2(record, 3), 0).xyz, eye = texelFetch(frames, ivec2(record, 4), 0).xyz;

    float all_of_them = 0.0;
    for (int i = 0; i < emitter_cluster_count; ++i) all_of_them += cluster_importance(i, eye);

    vec3 E = vec3(0.0);
    mat3 M = mat3(0.0), G = mat3(0.0);
    vec3 H = vec3(0.0);
    for (float s = float(inside.y * blocks.x + inside.x); s < emitter_samples; s += float(blocks.x * blocks.y))
    {
        // a lattice in the unit square, shifted from record to record: along it the emitters, across it each triangle
        float u = fract(s / emitter_samples + tangent.w) * all_of_them, v = fract(s * GOLDEN + bitangent.w);
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
            bool less = texelFetch(emitter_triangles, table_texel(middle), 0).y < u;
            low = less ? middle + 1 : low;
            high = less ? high : middle;
        }
        vec4 chosen = texelFetch(emitter_triangles, table_texel(low), 0);
        float before = low > first ? texelFetch(emitter_triangles, table_texel(low - 1), 0).y : 0.0;
        u = sqrt(clamp((u - before) / max(chosen.y - before, 1e-20), 0.0, 1.0));
        vec3 share = vec3(1.0 - u, u * (1.0 - v), u * v);

        int triangle = int(chosen.x);
        vec3 a = bvh_corner(triangle, 0).xyz, b = bvh_corner(triangle, 1).xyz, c = bvh_corner(triangle, 2).xyz;
        ivec3 number = bvh_vertices(triangle);
        vec3 away = share.x * a + share.y * b + share.z * c - eye, normal = normalize(cross(b - a, c - a));
        vec3 x = away * frame, m = normal * frame;  // in the record's frame
        bool behind = dot(m, x) > 0.0;
        m = behind ? m : -m;
        float r2 = dot(x, x), r = sqrt(r2), cosine = dot(m, x) / r;
        bool possible = x.z > 0.0 && dot(x, g) > 0.0 && cosine > 0.0 && !(behind && chosen.w > 0.5);
        float far = possible ? r * (1.0 - SHORT) : 0.0;
        if (!(bvh_between(eye, away / r, 0.0, far).t >= far) || !possible) continue;
        Vertex A = vertex_at(number.x), B = vertex_at(number.y), C = vertex_at(number.z), point = interpolate(share, A, B, C);
#if CUT_OUTS
        if (bvh_corner(triangle, 0).w < 0.0 && light_passes(point)) continue;
#endif

        // density of samples, and of rays, on the emitter: m⁻²
        float samples = emitter_samples * chosen.z * importance / all_of_them, found = ray_density(x / r) * cosine / r2;
#if TEXTURES
        Material material = material_mean(point, texture_area(1.0 / samples, A, B, C));
#else
        Material material = material_of(point);
#endif
        vec3 L = material.emission / (samples + found / WORTH);
        float height = x.z, facing = cosine * r, r4 = r2 * r2;
        E += L * (height * facing / r4);
#if GRADIENTS
        // E goes as f = (n·x)(m·x)/r⁴; as the record moves by δ, x changes by -δ
        float f = height * facing / r4;
        M += outerProduct(x * (facing / r4), L);
        G += outerProduct(4.0 * f / r2 * x - (height * m + vec3(0.0, 0.0, facing)) / r4, L);
        vec3 xx = vec3(x.x * x.x, x.x * x.y, x.y * x.y), mx = vec3(2.0 * m.x * x.x, m.x * x.y + m.y * x.x, 2.0 * m.y * x.y);
        H += dot(L, LUMINANCE) * (24.0 * f / r4 * xx - 4.0 * height / (r4 * r2) * mx - 4.0 * f / r2 * vec3(1.0, 0.0, 1.0));
#endif
    }
    // the other channels are no sums of light
    out_sums = vec4(E, 0.0);
    out_share = vec2(0.0);
#if GRADIENTS
    out_m_r = vec4(M[0], H.x);
    out_m_g = vec4(M[1], H.y);
    out_m_b = vec4(M[2], H.z);
    out_g_r = vec4(G[0], 0.0);
    out_g_g = vec4(G[1], 0.0);
    out_g_b = vec4(G[2], 0.0);
#endif
}
