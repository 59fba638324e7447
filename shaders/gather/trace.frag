// Radiance that comes to a record along one ray, and how far it comes: the fragment is the ray's stratum in the record's cell.
#include "lighting/lights.glsl"
#include "generated/vertex_table.glsl"
#include "lib/material.glsl"
#include "lib/material_table.glsl"
#include "lib/normals.glsl"
#if KNOWN_HITS
#include "lib/rays/known_hit.glsl"
#else
#include "lib/rays/bvh.glsl"
#endif
#include "gather/places.glsl"
#if EMITTERS
#include "lighting/emitters_hit.glsl"
#endif
#if VIRTUAL_LIGHTS
#include "lighting/virtual_lights/hit.glsl"
#endif
#if EMITTERS || VIRTUAL_LIGHTS
#include "gather/ray_density.glsl"
#endif
#if SURFACE
#include "surface_cache/lookup.glsl"
#include "gather/close_hits.glsl"
#endif

uniform sampler2D frames;    // texels (i, 0..2): tangent, bitangent and normal at place i, (i, 4): eye position
uniform sampler2D directions;  // of the rays in a record's frame, for each texel of a cell
uniform ivec2 cell;          // azimuths and elevations of a record
uniform int columns;         // cells per row
uniform float near;          // metres
uniform int closed;          // triangles of lower numbers belong to closed meshes
#if KNOWN_HITS
uniform isampler2D first_hits;  // of each ray, record by record, the triangle that it hits first; -1: none
#endif

layout(location = 0) out vec4 out_radiance;  // rgb W/(m² sr), a distance in metres (0: nothing hit, the sky)
layout(location = 1) out vec4 out_plane;     // plane of the hit: 1/distance in the unit direction w is dot(xyz, w), metres⁻¹; w: -1 on the
                                             // inner side of a closed mesh, else the pair of close_hits.glsl
#if HITS
uniform bool survey;  // true if a hit counts for the nearest site, and not for one drawn by its weight

layout(location = 2) out vec4 out_albedo;  // reflectance at the hit; a: number of a value of the surface cache there, -1: none
layout(location = 3) out vec4 out_place;   // where that is, and on which triangle
layout(location = 4) out vec4 out_normal;  // the shading normal there
#endif

// The irradiance by light i of a receiver, the hit of a ray from the eye, `away` from it. ray: direction in the record's frame.
vec3 irradiance_at_hit(int i, Receiver receiver, vec3 eye, vec3 away, vec3 ray)
{
    float spread;
    vec3 E = light_irradiance(i, receiver, spread);
#if VIRTUAL_LIGHTS
    E *= light_share(i, receiver.p, spread, away, receiver.g, ray_density(ray));
#endif
    // Software renderers look up shadows for all hits. Hits without light look up the eye's, which is in the processor's cache.
    bool lit = E.r + E.g + E.b > 0.0;
    float share = visibility(i, Receiver(lit ? receiver.p : eye, receiver.n, receiver.g, FLAT), 1, vec2(1.0, 0.0));
    return lit ? E * share : vec3(0.0);
}

void main()
{
    vec2 place = floor(gl_FragCoord.xy / vec2(cell)), inside = gl_FragCoord.xy - place * vec2(cell);
    int record = int(place.y) * columns + int(place.x);
    int from = place_of_texel(record, ivec2(inside));
    mat3 frame = mat3(texel_at(frames, ivec2(from, 0)).xyz, texel_at(frames, ivec2(from, 1)).xyz,
                      texel_at(frames, ivec2(from, 2)).xyz);
    vec3 eye = texel_at(frames, ivec2(from, 4)).xyz;

    vec3 ray = texel_at(directions, ivec2(inside)).xyz, d = normalize(frame * ray);
#if KNOWN_HITS
    int number = (record * cell.y + int(inside.y)) * cell.x + int(inside.x);
    Hit hit = known_hit(eye, d, texel_at(first_hits, table_texel(number)).r);
#else
    Hit hit = bvh_between(eye, d, 0.0, FARTHEST_HIT);
#endif
    vec3 corner[3] = vec3[](triangle_point(hit.triangle, 0), triangle_point(hit.triangle, 1), triangle_point(hit.triangle, 2));
    ivec3 at = triangle_vertices(hit.triangle);
    vec3 g = normalize(cross(corner[1] - corner[0], corner[2] - corner[0]));
    bool behind = dot(g, d) > 0.0, inner = behind && hit.triangle < closed;
    g = behind ? -g : g;  // turned to the record
    vec3 away = d * hit.t;
    float k = dot(g, away);
    Vertex A = vertex_at(at.x), B = vertex_at(at.y), C = vertex_at(at.z), seen = interpolate(hit.barycentric, A, B, C);
    Receiver receiver = Receiver(eye + away, shading_normal(seen.normal, g), g, FLAT);
    // the stratum is π/(cell.x·cell.y) of cosθ·dω, and sees that many steradians' t²/cosθ' of the surface
    float solid = PI / (float(cell.x) * float(cell.y) * ray.z);
    Material material = material_mean(seen, texture_area(solid * hit.t * hit.t / max(-dot(g, d), 0.05), A, B, C));
#if EMITTERS
    material.emission *= ray_share(hit.triangle, eye, d, hit.t, g, ray_density(ray));
#endif
    vec3 E = vec3(0.0);
    // the first ones one by one, as direct_irradiance has them
#if LIGHTS > 0
    E += irradiance_at_hit(0, receiver, eye, away, ray);
#endif
#if LIGHTS > 1
    E += irradiance_at_hit(1, receiver, eye, away, ray);
#endif
#if LIGHTS > 2
    E += irradiance_at_hit(2, receiver, eye, away, ray);
#endif
    for (int light = 3; light < LIGHTS; ++light) E += irradiance_at_hit(light, receiver, eye, away, ray);
#if HITS
    // HITS implies SURFACE
    Lookup lookup = surface_lookup(hit.triangle, hit.barycentric, int(behind));
    // One of three values is drawn by its weight, so that the mean over a record's rays is right. The shifts of records and rays
    // are those of the R2 sequence and of the golden ratio.
    float shift = fract(texel_at(frames, ivec2(from, 3)).w * PLASTIC) + (floor(inside.y) * float(cell.x) + floor(inside.x)) * GOLDEN;
    int value = survey ? surface_nearest(lookup) : surface_drawn(lookup, fract(shift));
    value = hit.t < FARTHEST_HIT ? value : -1;
    out_albedo = value < 0 ? vec4(0.0, 0.0, 0.0, -1.0) : vec4(material.albedo, float(value));
    out_place = vec4(receiver.p, float(hit.triangle));
    out_normal = vec4(receiver.n, 0.0);
#elif SURFACE
    vec4 further = surface_irradiance(hit.triangle, hit.barycentric, int(behind));
    E += further.rgb;
#endif
    vec3 L = outgoing_radiance(material, E);
    out_radiance = hit.t < FARTHEST_HIT ? vec4(L, max(hit.t, 0.05 * near)) : vec4(0.0);
    float close = 0.0;
#if SURFACE && !HITS
    float reflected = max(1.0 - hit.t / ((places > 1 ? CLOSE.y : CLOSE.x) * max(further.a, near)), 0.0) * dot(material.albedo, LUMINANCE);
    close = joined(vec2(reflected * dot(further.rgb, LUMINANCE) / max(PI * dot(L, LUMINANCE), 1e-20), reflected));
#endif
    out_plane = hit.t < FARTHEST_HIT ? vec4(g / min(k, -0.05 * near), inner ? -1.0 : close) : vec4(0.0);
}
