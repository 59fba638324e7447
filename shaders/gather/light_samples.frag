// What light samples add to the sums of a block of a record: points of emitters, seen by shadow rays. Each counts by the balance
// heuristic, so that what rays find by chance (emitters_hit.glsl) and these together are all that emitters bring.
#include "lighting/emitter_sample.glsl"
#include "gather/ray_density.glsl"

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

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), place = at / blocks, inside = at - place * blocks;
    int record = place.y * columns + place.x;
    vec4 tangent = texelFetch(frames, ivec2(record, 0), 0), bitangent = texelFetch(frames, ivec2(record, 1), 0);
    mat3 frame = mat3(tangent.xyz, bitangent.xyz, texelFetch(frames, ivec2(record, 2), 0).xyz);
    vec3 g = texelFetch(frames, ivec2(record, 3), 0).xyz, eye = texelFetch(frames, ivec2(record, 4), 0).xyz;

    float all_of_them = all_importance(eye);
    vec3 E = vec3(0.0);
    mat3 M = mat3(0.0), G = mat3(0.0);
    vec3 H = vec3(0.0);
    for (float s = float(inside.y * blocks.x + inside.x); s < emitter_samples; s += float(blocks.x * blocks.y))
    {
        // a lattice in the unit square, shifted from record to record: along it the emitters, across it each triangle
        Emitter chosen = choose_emitter(fract(s / emitter_samples + tangent.w) * all_of_them, eye);
        vec3 share = even_point(chosen.rest, fract(s * GOLDEN + bitangent.w));

        int triangle = chosen.triangle;
        vec3 a = bvh_corner(triangle, 0).xyz, b = bvh_corner(triangle, 1).xyz, c = bvh_corner(triangle, 2).xyz;
        vec3 away = share.x * a + share.y * b + share.z * c - eye, normal = normalize(cross(b - a, c - a));
        vec3 x = away * frame, m = normal * frame;  // in the record's frame
        bool behind = dot(m, x) > 0.0;
        m = behind ? m : -m;
        float r2 = dot(x, x), r = sqrt(r2), cosine = dot(m, x) / r;
        bool possible = x.z > 0.0 && dot(x, g) > 0.0 && cosine > 0.0 && !(behind && chosen.one_sided);
        if (!emitter_free(eye, away, r, possible)) continue;

        // density of samples, and of rays, on the emitter: m⁻²
        float samples = emitter_samples * chosen.density * chosen.importance / all_of_them, found = ray_density(x / r) * cosine / r2;
        vec3 L = emitter_radiance(triangle, share, 1.0 / samples) / (samples + found / WORTH);
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
