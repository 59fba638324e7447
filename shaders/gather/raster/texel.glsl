// What comes along the ray of a texel from the triangle that it sees: emission and shadow-mapped direct light, and how far it is.
#define FOOTPRINT
#include "lighting/lights.glsl"
#include "lib/material.glsl"
#include "lib/material_table.glsl"
#include "lib/surface.glsl"
#if EMITTERS
#include "lighting/emitters_hit.glsl"
#endif
#if VIRTUAL_LIGHTS
#include "lighting/virtual_lights/hit.glsl"
#endif
#if SURFACE
#include "surface_cache/lookup.glsl"
#endif

uniform float near;  // metres
uniform int closed;  // triangles of lower numbers belong to closed meshes

flat in vec2 v_centre;
flat in vec3 v_eye;
flat in vec3 v_right;
flat in vec3 v_up;
flat in vec3 v_ahead;

layout(location = 0) out vec4 out_radiance;  // rgb W/(m² sr), a distance in metres (0: nothing hit, the sky)
layout(location = 1) out vec4 out_plane;     // of what is hit: 1/distance in the unit direction w is dot(xyz, w), metres⁻¹; w: 1 where it
                                             // is the inner side of a closed mesh

const float FARTHEST = 4.0;  // times the centre's depth, where a corner looks past the plane's horizon

// The direction whose w is 1.
vec3 texel_ray()
{
    vec2 from_centre = gl_FragCoord.xy - v_centre;
    return v_ahead + from_centre.x * v_right + from_centre.y * v_up;
}

// Where the texel's ray q meets the triangle's plane: relative to the eye, the plane's normal turned to the record, and its distance
// times -1; whether that is the side to which its corners wind clockwise.
struct Met
{
    vec3 q;
    vec3 away;
    vec3 g;
    float k;
    bool inner;
};

// What a texel with this ray sees of the triangle of this number; it sets `footprint` and `footprint_area`, too.
Met meet(int triangle, vec3 q)
{
    // The surface's place by intersection of the texel's ray with the triangle's plane: an interpolated one is too coarse for
    // the shadow test where a large triangle passes close to the record.
    vec4 plane = face_plane(triangle);
    float k = plane.w - dot(plane.xyz, v_eye);
    vec3 g = k > 0.0 ? -plane.xyz : plane.xyz;  // turned to the record
    bool inner = k > 0.0;
    k = -abs(k);
    float depth = k / min(dot(g, q), -1e-20);
    vec3 away = q * depth;

    // what the texel sees of that plane
    vec3 x = 0.5 * v_right, y = 0.5 * v_up;
    vec3 corners[4] = vec3[](q - x - y, q + x - y, q + x + y, q - x + y);
    for (int i = 0; i < 4; ++i)
    {
        float t = k / min(dot(g, corners[i]), -1e-20);
        footprint[i] = corners[i] * min(t, FARTHEST * depth) - away;
    }
    footprint_area = 0.5 * length(cross(footprint[2] - footprint[0], footprint[3] - footprint[1])) + 1e-30;
    return Met(q, away, g, k, inner);
}

// The outputs, for the triangle of this number, seen at this point of it (whose position is not looked at).
void see(int triangle, Met met, Vertex point, Material material)
{
    vec3 g = met.g;
    Receiver receiver = Receiver(v_eye + met.away, shading_normal(point.normal, g), g, FLAT);
    float far = length(met.away), length_q = length(met.q);  // a texel takes up |(right × up)·q|/|q|³ steradians
    float texels = length_q * length_q * length_q / abs(dot(cross(v_right, v_up), met.q));
#if VIRTUAL_LIGHTS
    vec3 E = vec3(0.0);
    for (int light = 0; light < LIGHTS; ++light)
    {
        float spread;
        vec3 brought = light_irradiance(light, receiver, spread);
        if (brought.r + brought.g + brought.b > 0.0) brought *= visibility(light, receiver, 1, vec2(1.0, 0.0));
        E += brought * lamp_share(light, receiver.p, spread, met.away, g, texels);
    }
#else
    vec3 E = direct_irradiance(receiver, 1, vec2(1.0, 0.0));
#endif
#if SURFACE
    E += surface_irradiance(triangle, receiver.p, g);
#endif
#if EMITTERS
    material.emission *= ray_share(triangle, v_eye, met.away / far, far, g, texels);
#endif
    out_radiance = vec4(outgoing_radiance(material, E), max(far, 0.05 * near));
    out_plane = vec4(g / min(met.k, -0.05 * near), met.inner && triangle < closed);
}
