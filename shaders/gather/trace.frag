// The gather by rays: radiance and distance at the first hit of a ray (METHOD.md, 3.4, 3.7). A fragment is the ray of one stratum
// in a record's cell. KNOWN_HITS: 1 if Embree has found the triangles. SURFACE: 1 if hits reflect light of the surface cache.
// HITS: 1 for rays of the surface cache, which also output the position and the value of each hit.
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

uniform sampler2D frames;    // texels (i, 0..2): tangent, bitangent and normal at eye i; (i, 3): geometric normal in this frame,
                             // number of the record; (i, 4): eye, world space
uniform sampler2D directions;  // ray directions in the record's frame, one cell
uniform ivec2 cell;          // numbers of azimuths and elevations per record
uniform int columns;         // cells per row
uniform float near;          // offset of the eye from its surface, metres
uniform int closed;          // triangles of lower numbers belong to closed meshes
#if KNOWN_HITS
uniform isampler2D first_hits;  // number of the first triangle of each ray, record by record; -1: no hit
#endif

layout(location = 0) out vec4 out_radiance;  // rgb: radiance, W/(m² sr); a: distance, metres, 0 for the sky
layout(location = 1) out vec4 out_plane;     // plane of the hit: dot(xyz, ω) is 1/distance in the unit direction ω, metres⁻¹; w: -1 on
                                             // the inner side of a closed mesh, else the pair of close_hits.glsl
#if HITS
layout(location = 2) out vec4 out_albedo;  // reflectance at the hit; a: number of the value of the surface cache, -1: none, or the
                                           // ray is below the surface of the eye
layout(location = 3) out vec4 out_place;   // position of the hit, world space, metres; w: number of the triangle
layout(location = 4) out vec4 out_normal;  // shading normal at the hit
#endif

// Return the irradiance by light i, W/m², at the hit of a ray. to_hit: vector from the eye, metres. ray: direction in the
// record's frame.
vec3 irradiance_at_hit(int i, Receiver receiver, vec3 eye, vec3 to_hit, vec3 ray)
{
    float spread;
    vec3 E = light_irradiance(i, receiver, spread);
#if VIRTUAL_LIGHTS
    E *= light_weight(i, receiver.p, spread, to_hit, receiver.g, ray_density(ray));
#endif
    // Software renderers read the shadow map for all hits. Unlit hits read it at the eye, in the processor's cache.
    bool lit = E.r + E.g + E.b > 0.0;
    float visible = visibility(i, Receiver(lit ? receiver.p : eye, receiver.n, receiver.g, FLAT), 1, vec2(1.0, 0.0));
    return lit ? E * visible : vec3(0.0);
}

void main()
{
    vec2 index = floor(gl_FragCoord.xy / vec2(cell)), inside = gl_FragCoord.xy - index * vec2(cell);
    int record = int(index.y) * columns + int(index.x);
    int eye_column = place_of_texel(record, ivec2(inside));
    mat3 frame = mat3(texel_at(frames, ivec2(eye_column, 0)).xyz, texel_at(frames, ivec2(eye_column, 1)).xyz,
                      texel_at(frames, ivec2(eye_column, 2)).xyz);
    vec3 eye = texel_at(frames, ivec2(eye_column, 4)).xyz;

    vec3 ray = texel_at(directions, ivec2(inside)).xyz, d = normalize(frame * ray);
    vec4 horizon = texel_at(frames, ivec2(eye_column, 3));
    bool above = dot(ray, horizon.xyz) > 0.0;  // else the ray hits the surface of the eye itself
#if KNOWN_HITS
    int number = (record * cell.y + int(inside.y)) * cell.x + int(inside.x);
    Hit hit = known_hit(eye, d, texel_at(first_hits, table_texel(number)).r);
#else
    Hit hit = bvh_between(eye, d, 0.0, FARTHEST_HIT);
#endif
    vec3 corner[3] = vec3[](triangle_point(hit.triangle, 0), triangle_point(hit.triangle, 1), triangle_point(hit.triangle, 2));
    ivec3 vertices = triangle_vertices(hit.triangle);
    vec3 g = normalize(cross(corner[1] - corner[0], corner[2] - corner[0]));
    bool behind = dot(g, d) > 0.0, inner = behind && hit.triangle < closed;
    g = behind ? -g : g;  // on the side of the record
    vec3 to_hit = d * hit.t;
    float kappa = dot(g, to_hit);
    Vertex A = vertex_at(vertices.x), B = vertex_at(vertices.y), C = vertex_at(vertices.z);
    Vertex point = interpolate(hit.barycentric, A, B, C);
    Receiver receiver = Receiver(eye + to_hit, shading_normal(point.normal, g), g, FLAT);
    // a stratum has cosθ·dω = π/(cell.x·cell.y), and covers dω·t²/cosθ' of the surface
    float solid_angle = PI / (float(cell.x) * float(cell.y) * ray.z);
    Material material = material_mean(point, texture_area(solid_angle * hit.t * hit.t / max(-dot(g, d), 0.05), A, B, C));
#if EMITTERS
    material.emission *= emission_weight(hit.triangle, eye, d, hit.t, g, ray_density(ray));
#endif
    vec3 E = vec3(0.0);
    // three unrolled steps, as in direct_irradiance
#if LIGHTS > 0
    E += irradiance_at_hit(0, receiver, eye, to_hit, ray);
#endif
#if LIGHTS > 1
    E += irradiance_at_hit(1, receiver, eye, to_hit, ray);
#endif
#if LIGHTS > 2
    E += irradiance_at_hit(2, receiver, eye, to_hit, ray);
#endif
    for (int light = 3; light < LIGHTS; ++light) E += irradiance_at_hit(light, receiver, eye, to_hit, ray);
#if HITS
    // HITS implies SURFACE.
    Lookup lookup = surface_lookup(hit.triangle, hit.barycentric, int(behind));
    // One of three values is drawn by its weight, so that the mean over the rays of a record
    // is unbiased. The random number advances by the R2 sequence from record to record, and by the golden ratio from ray to ray.
    float shift = fract(horizon.w * PLASTIC) + (floor(inside.y) * float(cell.x) + floor(inside.x)) * GOLDEN;
    int value = places == 1 ? surface_nearest(lookup) : surface_drawn(lookup, fract(shift));
    value = above && hit.t < FARTHEST_HIT ? value : -1;
    out_albedo = value < 0 ? vec4(0.0, 0.0, 0.0, -1.0) : vec4(material.albedo, float(value));
    out_place = vec4(receiver.p, float(hit.triangle));
    out_normal = vec4(receiver.n, 0.0);
#elif SURFACE
    vec4 cached = surface_irradiance(hit.triangle, hit.barycentric, int(behind));
    E += cached.rgb;
#endif
    vec3 L = outgoing_radiance(material, E);
    out_radiance = hit.t < FARTHEST_HIT ? vec4(L, max(hit.t, 0.05 * near)) : vec4(0.0);
    float close = 0.0;
#if SURFACE && !HITS
    // ν·ρ: see METHOD.md, 11.5
    float nu_rho = max(1.0 - hit.t / ((places > 1 ? CLOSE.y : CLOSE.x) * max(cached.a, near)), 0.0) * dot(material.albedo, LUMINANCE);
    vec2 pair = vec2(nu_rho * dot(cached.rgb, LUMINANCE) / max(PI * dot(L, LUMINANCE), 1e-20), nu_rho);
    close = above ? pack_pair(pair) : 0.0;
#endif
    out_plane = hit.t < FARTHEST_HIT ? vec4(g / min(kappa, -0.05 * near), inner ? -1.0 : close) : vec4(0.0);
}
