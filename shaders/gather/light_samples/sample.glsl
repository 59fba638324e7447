// One of a record's light samples: which point of an emitter it is, and how the record sees that.
#include "lighting/emitter_sample.glsl"

uniform sampler2D frames;  // texels (i, 0..3) as in reduce_blocks.frag, w of 0 and 1: two random numbers, (i, 4): the eye, and how far
                           // beside it others look from, metres

const float GOLDEN = 0.61803399;

// A record as light samples take it.
struct Viewpoint
{
    mat3 frame;        // tangent, bitangent, normal
    vec3 g;            // geometric normal in that frame
    vec3 eye;          // where it looks from
    float step;        // metres, to the eyes beside it
    vec2 shift;        // of its lattice of samples
    float importance;  // of all clusters
};

Viewpoint viewpoint(int record)
{
    vec4 tangent = texelFetch(frames, ivec2(record, 0), 0), bitangent = texelFetch(frames, ivec2(record, 1), 0);
    vec4 eye = texelFetch(frames, ivec2(record, 4), 0);
    mat3 frame = mat3(tangent.xyz, bitangent.xyz, texelFetch(frames, ivec2(record, 2), 0).xyz);
    vec3 g = texelFetch(frames, ivec2(record, 3), 0).xyz;
    return Viewpoint(frame, g, eye.xyz, eye.w, vec2(tangent.w, bitangent.w), all_importance(eye.xyz));
}

struct LightSample
{
    Emitter emitter;
    vec3 share;     // of the triangle's corners
    vec3 away;      // from the eye to the point, metres
    vec3 x;         // the same in the record's frame
    vec3 m;         // the emitter's normal in that frame, turned away from the record
    float r;        // metres
    float cosine;   // at the emitter
    bool possible;  // whether light may come from there, if nothing stands in the way
};

// Number s of the samples, a lattice in the unit square, shifted from record to record: along it the emitters, across it each
// triangle.
LightSample light_sample(float s, Viewpoint from)
{
    Emitter chosen = choose_emitter(fract(s / emitter_samples + from.shift.x) * from.importance, from.eye);
    vec3 share = even_point(chosen.rest, fract(s * GOLDEN + from.shift.y));
    int triangle = chosen.triangle;
    vec3 a = bvh_corner(triangle, 0).xyz, b = bvh_corner(triangle, 1).xyz, c = bvh_corner(triangle, 2).xyz;
    vec3 away = share.x * a + share.y * b + share.z * c - from.eye, normal = normalize(cross(b - a, c - a));
    vec3 x = away * from.frame, m = normal * from.frame;
    bool behind = dot(m, x) > 0.0;
    m = behind ? m : -m;
    float r = length(x), cosine = dot(m, x) / r;
    bool possible = x.z > 0.0 && dot(x, from.g) > 0.0 && cosine > 0.0 && !(behind && chosen.one_sided);
    return LightSample(chosen, share, away, x, m, r, cosine, possible);
}
