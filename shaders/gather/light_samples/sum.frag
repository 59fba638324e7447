// Next-event estimation: contribution of light sources to the sums of a block of a record, by shadow rays. The balance heuristic
// weights each sample against ray hits of the same source (lighting/emitters_hit.glsl, lighting/virtual_lights/hit.glsl).
// For records with derivatives, additional eyes in a circle sample the same points: differences in visibility give the motion of
// shadows (docs/METHOD.md, 3.8).
#include "gather/light_samples/sample.glsl"
#if !SEEN
#include "lib/rays/bvh.glsl"
#endif
#include "gather/ray_density.glsl"
#include "gather/places.glsl"

uniform ivec2 blocks;    // of a cell
uniform int columns;     // cells per row
uniform int samples;     // of a record
uniform vec2 span;       // of these: the first one, and the one after the last
#if SEEN
uniform sampler2D seen;  // texel (s, i): visibility of sample s of record i, bit 0, and from the additional eyes, bits from 1 on;
                         // texel (samples, i): bits of the additional eyes with a free way from the first
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

// Offset of eye number k (from 1 on) from the record's eye, in metres; number 0 is the eye itself.
vec3 beside(int k, Viewpoint from)
{
    float angle = float(k - 1) * (2.0 * PI / float(EYES_BESIDE));
    return k == 0 ? vec3(0.0) : from.step * (cos(angle) * from.frame[0] + sin(angle) * from.frame[1]);
}

#if !SEEN
// The visibility of the point `away` from the first eye, for the first `eyes` eyes: a bit for each.
int seeing(int eyes, Viewpoint from, vec3 away, bool possible)
{
    int bits = 0;
    for (int k = 0; k < eyes; ++k)
    {
        vec3 aside = beside(k, from), way = away - aside;
        bits |= bvh_segment_free(from.eye + aside, way, length(way), possible) ? 1 << k : 0;
    }
    return bits;
}
#endif

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), place = at / blocks, inside = at - place * blocks;
    int record = place.y * columns + place.x;
    Viewpoint from = viewpoint(place_of_sample(record, 0));
    vec3 E = vec3(0.0);
#if GRADIENTS
    mat3 M = mat3(0.0), G = mat3(0.0);
    vec3 H = vec3(0.0);
#if SEEN
    int reached = int(texel_at(seen, ivec2(samples, record)).r);
#else
    int reached = 0;
    for (int k = 1; k <= EYES_BESIDE; ++k)
    {
        vec3 aside = beside(k, from);
        reached |= bvh_segment_free(from.eye, aside, from.step, true) ? 1 << k : 0;
    }
#endif
#endif
    for (float s = span.x + float(inside.y * blocks.x + inside.x); s < span.y; s += float(blocks.x * blocks.y))
    {
#if !GRADIENTS
        from = viewpoint(place_of_sample(record, int(s)));
#endif
        LightSample point = light_sample(s, from);
#if SEEN
        int bits = int(texel_at(seen, ivec2(int(s), record)).r);
#else
        int bits = seeing(GRADIENTS > 0 ? EYES_BESIDE + 1 : 1, from, point.source.away, point.possible);
#endif
        if (bits == 0) continue;
        // in units of r, since r⁻⁶ is more than a float holds where a scene is very small
        vec3 w = point.x / point.r, m = point.m;
        float r = point.r, r2 = r * r, height = w.z, facing = point.cosine, visible = float(bits & 1);

        float found = ray_density(w) * facing / r2;  // rays that meet there, m⁻²
        vec3 L = source_radiance(point.source) / (point.source.density + found / WORTH);
        float f = height * facing / r2;
        E += visible * f * L;
#if GRADIENTS
        // of the visibility V, by a polynomial through the visibility at the eyes: six on a circle determine its second derivatives
        vec2 dV = vec2(0.0);
        vec3 ddV = vec3(0.0);  // xx, xy, yy
        for (int k = 1; k <= EYES_BESIDE; ++k)
        {
            // an eye without a free way is extrapolated from the opposite one
            int opposite = (k - 1 + EYES_BESIDE / 2) % EYES_BESIDE + 1;
            float there = float((bits >> k) & 1), other = float((bits >> opposite) & 1);
            float change = ((reached >> k) & 1) > 0 ? there - visible : ((reached >> opposite) & 1) > 0 ? visible - other : 0.0;
            float angle = float(k - 1) * (2.0 * PI / float(EYES_BESIDE)), c = cos(2.0 * angle), d = sin(2.0 * angle);
            dV += change * vec2(cos(angle), sin(angle));
            ddV += change * vec3(1.0 + 2.0 * c, 2.0 * d, 1.0 - 2.0 * c);
        }
        dV *= 2.0 / (float(EYES_BESIDE) * from.step);
        ddV *= 2.0 / (float(EYES_BESIDE) * from.step * from.step);

        // E is proportional to V·f, f = (n·x)(m·x)/r⁴; as the record moves by δ, x changes by -δ
        vec3 df = (4.0 * height * facing * w - height * m - vec3(0.0, 0.0, facing)) / (r2 * r);
        vec3 ww = vec3(w.x * w.x, w.x * w.y, w.y * w.y), mw = vec3(2.0 * m.x * w.x, m.x * w.y + m.y * w.x, 2.0 * m.y * w.y);
        vec3 ddf = 4.0 * height * (6.0 * facing * ww - mw - facing * vec3(1.0, 0.0, 1.0)) / (r2 * r2);
        vec3 both = vec3(2.0 * df.x * dV.x, df.x * dV.y + df.y * dV.x, 2.0 * df.y * dV.y);
        M += outerProduct(w * (visible * facing / r2), L);
        G += outerProduct(visible * df + f * vec3(dV, 0.0), L);
        H += dot(L, LUMINANCE) * (visible * ddf + both + f * ddV);
#endif
    }
    // the other channels are no sums of light
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
