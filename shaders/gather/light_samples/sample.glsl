// Next-event estimation of a record: sample s and its geometry (METHOD.md, 3.8). VIRTUAL: 1 for virtual point lights
// (irrsplat/lighting/virtual_lights.py), 0 for points on emitters.
#include "generated/constants.glsl"
#include "lib/texel.glsl"
#if VIRTUAL
uniform sampler2D virtual_places;    // a column of three texels per virtual light, one set per three rows: position, density
                                     // of the set, m⁻²; unit normal on the side of the light source, number of the
                                     // source; barycentric coordinates, number of the triangle
uniform sampler2D virtual_radiance;  // outgoing radiance of each virtual light, W/(m² sr)
#else
#include "lighting/emitter_sample.glsl"
#endif

uniform sampler2D frames;  // texels (i, 0..3): as in reduce_blocks.frag; w of (i, 0) and (i, 1): two random numbers; (i, 4): the
                           // eye, world space, and the radius of the circle of additional eyes, metres

// A record as the receiver of next-event estimation.
struct Viewpoint
{
    mat3 frame;        // tangent, bitangent, normal
    vec3 g;            // unit geometric normal, in the frame
    vec3 eye;          // origin of the rays, world space
    float step;        // radius of the circle of additional eyes, metres
    vec2 shift;        // shift of the lattice of samples, 0..1
    float importance;  // sum over all clusters of emitters
};

// Return the receiver in column `record` of `frames`.
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
    vec3 to_source;  // vector from the eye, metres
    vec3 normal;     // unit, world space
    bool one_sided;  // true if only the side of the normal emits
    float density;   // density of samples at the source, m⁻²
#if VIRTUAL
    vec3 L;          // emitted radiance, W/(m² sr)
#else
    int triangle;      // number in the scene
    vec3 barycentric;  // coordinates on the triangle
#endif
};

#if VIRTUAL
// Return virtual light s of a set. Each record uses one set at random, because a single set would give all records equal errors.
Source source_of(float s, Viewpoint receiver)
{
    int sets = textureSize(virtual_radiance, 0).y;
    ivec2 number = ivec2(int(s), min(int(receiver.shift.x * float(sets)), sets - 1)), at = ivec2(1, 3) * number;
    vec4 position = texel_at(virtual_places, at);
    vec3 normal = texel_at(virtual_places, at + ivec2(0, 1)).xyz, L = texel_at(virtual_radiance, number).rgb;
    return Source(position.xyz - receiver.eye, normal, true, position.w, L);
}

// Return the emitted radiance, W/(m² sr).
vec3 source_radiance(Source source)
{
    return source.L;
}
#else
// Return sample s of a lattice in the unit square, shifted from record to record. The first axis selects an emissive triangle,
// the remainder of this axis and the second axis a point on the triangle.
Source source_of(float s, Viewpoint receiver)
{
    Emitter emitter = choose_emitter(fract(s / emitter_samples + receiver.shift.x) * receiver.importance, receiver.eye);
    vec3 barycentric = uniform_point(emitter.rest, fract(s * GOLDEN + receiver.shift.y));
    int triangle = emitter.triangle;
    vec3 a = triangle_point(triangle, 0), b = triangle_point(triangle, 1), c = triangle_point(triangle, 2);
    vec3 to_source = barycentric.x * a + barycentric.y * b + barycentric.z * c - receiver.eye, normal = normalize(cross(b - a, c - a));
    float density = emitter_samples * emitter.density * emitter.importance / receiver.importance;
    return Source(to_source, normal, emitter.one_sided, density, triangle, barycentric);
}

// Return the emitted radiance, W/(m² sr), as a mean over the area of a sample.
vec3 source_radiance(Source source)
{
    return emitter_radiance(source.triangle, source.barycentric, 1.0 / source.density);
}
#endif

// A next-event sample in the frame of the record.
struct LightSample
{
    Source source;
    vec3 x;         // vector from the eye to the source, metres
    vec3 m;         // unit normal of the source with m·x > 0
    float r;        // distance, metres
    float cosine;   // cosine at the source, m·x/r
    bool possible;  // true if an unoccluded source contributes
};

// Return next-event sample s of a receiver.
LightSample light_sample(float s, Viewpoint receiver)
{
    Source source = source_of(s, receiver);
    vec3 x = source.to_source * receiver.frame, m = source.normal * receiver.frame;
    bool back = dot(m, x) > 0.0;
    m = back ? m : -m;
    float r = length(x), cosine = dot(m, x) / r;
    bool possible = x.z > 0.0 && dot(x, receiver.g) > 0.0 && cosine > 0.0 && !(back && source.one_sided);
    return LightSample(source, x, m, r, cosine, possible);
}
