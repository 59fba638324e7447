// Next-event estimation: the contribution of light sources to the sums of a block of a record, by shadow rays (METHOD.md, 3.8).
// The balance heuristic weights each sample against rays that hit the source (lighting/emitters_hit.glsl,
// lighting/virtual_lights/hit.glsl). For records with derivatives, additional eyes on a circle test the samples, too: differences
// of visibility give its derivatives. SEEN: 1 if Embree has traced the shadow rays. The outputs are those of
// gather/reduce_blocks.frag.
#include "gather/light_samples/sample.glsl"
#if !SEEN
#include "lib/rays/bvh.glsl"
#endif
#include "gather/ray_density.glsl"
#include "gather/places.glsl"

uniform ivec2 blocks;    // columns and rows of blocks per cell
uniform int columns;     // cells per row
uniform int samples;     // samples per record
uniform vec2 span;       // samples of this draw: the first one, and the one after the last
#if SEEN
uniform sampler2D seen;  // texel (s, i): visibility of sample s of record i: bit 0 from the eye, bits 1.. from the additional
                         // eyes; texel (samples, i): bits of the additional eyes that are visible from the eye
#endif

layout(location = 0) out vec4 out_sums;
layout(location = 1) out vec4 out_share;
#if GRADIENTS
layout(location = 2) out vec4 out_m_r;
layout(location = 3) out vec4 out_m_g;
layout(location = 4) out vec4 out_m_b;
layout(location = 5) out vec4 out_g_r;
layout(location = 6) out vec4 out_g_g;
layout(location = 7) out vec4 out_g_b;
#endif

// Return the offset of eye k from the record's eye, world space, metres. Further eyes lie on the circle.
vec3 eye_offset(int k, Viewpoint receiver)
{
    float angle = float(k - 1) * (2.0 * PI / float(EYES_BESIDE));
    return k == 0 ? vec3(0.0) : receiver.step * (cos(angle) * receiver.frame[0] + sin(angle) * receiver.frame[1]);
}

#if !SEEN
// Return the visibility of a source for the first `eyes` eyes, one bit per eye. to_source: vector from eye 0, metres.
int visibility_bits(int eyes, Viewpoint receiver, vec3 to_source, bool possible)
{
    int bits = 0;
    for (int k = 0; k < eyes; ++k)
    {
        vec3 offset = eye_offset(k, receiver), from_eye = to_source - offset;
        bits |= bvh_segment_free(receiver.eye + offset, from_eye, length(from_eye), possible) ? 1 << k : 0;
    }
    return bits;
}
#endif

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy), index = texel / blocks, inside = texel - index * blocks;
    int record = index.y * columns + index.x;
    Viewpoint receiver = viewpoint(place_of_sample(record, 0));
    vec3 E = vec3(0.0);
#if GRADIENTS
    mat3 M = mat3(0.0), G = mat3(0.0);
    vec3 H = vec3(0.0);
#if SEEN
    int visible_eyes = int(texel_at(seen, ivec2(samples, record)).r);
#else
    int visible_eyes = 0;
    for (int k = 1; k <= EYES_BESIDE; ++k)
    {
        vec3 offset = eye_offset(k, receiver);
        visible_eyes |= bvh_segment_free(receiver.eye, offset, receiver.step, true) ? 1 << k : 0;
    }
#endif
#endif
    for (float s = span.x + float(inside.y * blocks.x + inside.x); s < span.y; s += float(blocks.x * blocks.y))
    {
#if !GRADIENTS
        receiver = viewpoint(place_of_sample(record, int(s)));
#endif
        LightSample point = light_sample(s, receiver);
#if SEEN
        int bits = int(texel_at(seen, ivec2(int(s), record)).r);
#else
        int bits = visibility_bits(GRADIENTS > 0 ? EYES_BESIDE + 1 : 1, receiver, point.source.to_source, point.possible);
#endif
        if (bits == 0) continue;
        // lengths are in units of r, because r⁻⁶ overflows a float in very small scenes
        vec3 w = point.x / point.r, m = point.m;
        float r = point.r, r2 = r * r, cosine = w.z, cosine_l = point.cosine, V = float(bits & 1);

        float hit_density = ray_density(w) * cosine_l / r2;  // rays that hit the source, m⁻²
        vec3 L = source_radiance(point.source) / (point.source.density + hit_density / WORTH);
        float f = cosine * cosine_l / r2;
        E += V * f * L;
#if GRADIENTS
        // derivatives of the visibility V, by finite differences: six eyes on a circle determine the second derivatives
        vec2 dV = vec2(0.0);
        vec3 ddV = vec3(0.0);  // xx, xy, yy
        for (int k = 1; k <= EYES_BESIDE; ++k)
        {
            // an eye behind a wall continues the difference at the opposite eye
            int opposite = (k - 1 + EYES_BESIDE / 2) % EYES_BESIDE + 1;
            float V_k = float((bits >> k) & 1), V_opposite = float((bits >> opposite) & 1);
            float difference = ((visible_eyes >> k) & 1) > 0 ? V_k - V : ((visible_eyes >> opposite) & 1) > 0 ? V - V_opposite : 0.0;
            float angle = float(k - 1) * (2.0 * PI / float(EYES_BESIDE)), c = cos(2.0 * angle), d = sin(2.0 * angle);
            dV += difference * vec2(cos(angle), sin(angle));
            ddV += difference * vec3(1.0 + 2.0 * c, 2.0 * d, 1.0 - 2.0 * c);
        }
        dV *= 2.0 / (float(EYES_BESIDE) * receiver.step);
        ddV *= 2.0 / (float(EYES_BESIDE) * receiver.step * receiver.step);

        // E is proportional to V·f with f = (n·x)(m·x)/r⁴; as the record moves by δ, x changes by -δ
        vec3 df = (4.0 * cosine * cosine_l * w - cosine * m - vec3(0.0, 0.0, cosine_l)) / (r2 * r);
        vec3 ww = vec3(w.x * w.x, w.x * w.y, w.y * w.y), mw = vec3(2.0 * m.x * w.x, m.x * w.y + m.y * w.x, 2.0 * m.y * w.y);
        vec3 ddf = 4.0 * cosine * (6.0 * cosine_l * ww - mw - cosine_l * vec3(1.0, 0.0, 1.0)) / (r2 * r2);
        vec3 cross_terms = vec3(2.0 * df.x * dV.x, df.x * dV.y + df.y * dV.x, 2.0 * df.y * dV.y);
        M += outerProduct(w * (V * cosine_l / r2), L);
        G += outerProduct(V * df + f * vec3(dV, 0.0), L);
        H += dot(L, LUMINANCE) * (V * ddf + cross_terms + f * ddV);
#endif
    }
    // the remaining channels are sums over rays only
    out_sums = vec4(E, 0.0);
    out_share = vec4(0.0);
#if GRADIENTS
    out_m_r = vec4(M[0], H.x);
    out_m_g = vec4(M[1], H.y);
    out_m_b = vec4(M[2], H.z);
    out_g_r = vec4(G[0], 0.0);
    out_g_g = vec4(G[1], 0.0);
    out_g_b = vec4(G[2], 0.0);
#endif
}
