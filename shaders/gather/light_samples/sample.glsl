// Next-event estimation of a record: a sample point and its contribution. With VIRTUAL the points are virtual point lights
// (irrsplat/lighting/virtual_lights.py), else points on emitters.
#include "generated/constants.glsl"
#include "lib/texel.glsl"
#if VIRTUAL
uniform sampler2D virtual_places;    // sets one above another, a column of three texels each: position, and density of
                                     // its set there, m⁻²; normal, turned to its light, and number of that light; the
                                     // shares of its triangle's corners, and that triangle's number
uniform sampler2D virtual_radiance;  // a texel each: its outgoing radiance, W/(m² sr)
#else
#include "lighting/emitter_sample.glsl"
#endif

uniform sampler2D frames;  // texels (i, 0..3) as in reduce_blocks.frag, w of 0 and 1: two random numbers, (i, 4): the eye, and
                           // the distance of the additional eyes, metres

// A record as the receiver of next-event estimation.
struct Viewpoint
{
    mat3 frame;        // tangent, bitangent, normal
    vec3 g;            // geometric normal in that frame
    vec3 eye;          // origin of its rays
    float step;        // metres, to the additional eyes
    vec2 shift;        // of its lattice of samples
    float importance;  // of all clusters of emitters
};

Viewpoint viewpoint(int record)
{
    vec4 tangent = texel_at(frames, ivec2(record, 0)), bitangent = texel_at(frames, ivec2(record, 1));
    vec4 eye = texel_at(frames, ivec2(record, 4));
    mat3 frame = mat3(tangent.xyz, bitangent.xyz, texel_at(frames, ivec2(record, 2)).xyz);
    vec3 g = texel_at(frames, ivec2(record, 3)).xyz;
#if VIRTUAL
    float importance = 0.0;
#else
    float importance = all_importance(eye.xyz);
#endif
    return Viewpoint(frame, g, eye.xyz, eye.w, vec2(tangent.w, bitangent.w), importance);
}

// The source of a next-event sample.
struct Source
{
    vec3 away;       // from the eye, metres
    vec3 normal;     // unit
    bool one_sided;  // true if light comes from the normal's side alone
    float density;   // of samples about there, m⁻²
#if VIRTUAL
    vec3 L;          // W/(m² sr)
#else
    int triangle;    // its number in the scene
    vec3 share;      // of its corners
#endif
};

#if VIRTUAL
// Number s of one of the sets, which are dealt out to records at random.
Source source(float s, Viewpoint from)
{
    int sets = textureSize(virtual_radiance, 0).y;
    ivec2 number = ivec2(int(s), min(int(from.shift.x * float(sets)), sets - 1)), at = ivec2(1, 3) * number;
    vec4 place = texel_at(virtual_places, at);
    vec3 normal = texel_at(virtual_places, at + ivec2(0, 1)).xyz, L = texel_at(virtual_radiance, number).rgb;
    return Source(place.xyz - from.eye, normal, true, place.w, L);
}

vec3 source_radiance(Source source)
{
    return source.L;
}
#else
// Number s of the samples, a lattice in the unit square, shifted from record to record: along it the emitters, across it each
// triangle.
Source source(float s, Viewpoint from)
{
    Emitter chosen = choose_emitter(fract(s / emitter_samples + from.shift.x) * from.importance, from.eye);
    vec3 share = even_point(chosen.rest, fract(s * GOLDEN + from.shift.y));
    int triangle = chosen.triangle;
    vec3 a = triangle_point(triangle, 0), b = triangle_point(triangle, 1), c = triangle_point(triangle, 2);
    vec3 away = share.x * a + share.y * b + share.z * c - from.eye, normal = normalize(cross(b - a, c - a));
    float density = emitter_samples * chosen.density * chosen.importance / from.importance;
    return Source(away, normal, chosen.one_sided, density, triangle, share);
}

vec3 source_radiance(Source source)
{
    return emitter_radiance(source.triangle, source.share, 1.0 / source.density);
}
#endif

struct LightSample
{
    Source source;
    vec3 x;         // from the eye to it in the record's frame, metres
    vec3 m;         // its normal in that frame, turned away from the record
    float r;        // metres
    float cosine;   // at the source
    bool possible;  // true if light may come from there, unless something occludes it
};

LightSample light_sample(float s, Viewpoint from)
{
    Source found = source(s, from);
    vec3 x = found.away * from.frame, m = found.normal * from.frame;
    bool behind = dot(m, x) > 0.0;
    m = behind ? m : -m;
    float r = length(x), cosine = dot(m, x) / r;
    bool possible = x.z > 0.0 && dot(x, from.g) > 0.0 && cosine > 0.0 && !(behind && found.one_sided);
    return LightSample(found, x, m, r, cosine, possible);
}
