// The gather of the paper (Jones 2010, 2.1): the radiance from the surface at each texel of a record's plane, by rasterisation.
// It is the sum of emission, shadow-mapped direct light and, with SURFACE, the light of the surface cache.
#include "lighting/lights.glsl"
#include "lib/material.glsl"
#include "lib/material_table.glsl"
#include "lib/surface.glsl"
#include "generated/interpolated.glsl"
#if SURFACE
#include "surface_cache/lookup.glsl"
#endif
#if CUT_OUTS
#include "lib/rays/cut_outs.glsl"
#endif

uniform float near;  // offset of the eye from its surface, metres
uniform int closed;  // triangles of lower numbers belong to closed meshes

// see plane.vert
flat in vec2 v_centre;
flat in vec3 v_eye;
flat in vec3 v_right;
flat in vec3 v_up;
flat in vec3 v_ahead;

layout(location = 0) out vec4 out_radiance;  // rgb: radiance, W/(m² sr); a: distance, metres, 0 for the sky
layout(location = 1) out vec4 out_plane;     // plane of the triangle: dot(xyz, ω) is 1/distance in the unit direction ω, metres⁻¹;
                                             // w: -1 on the inner side of a closed mesh, else 0

void main()
{
    Vertex point = interpolated_vertex(vec3(0.0));
    vec4 u = dFdx(point.uv), v = dFdy(point.uv);  // change per texel
    Material material = material_mean(point, abs(vec2(u.x * v.y - u.y * v.x, u.z * v.w - u.w * v.z)));
#if CUT_OUTS
    if (light_passes(point)) discard;
#endif
    // The position is the intersection of the texel's ray with the plane of the triangle. An interpolated position would be too
    // coarse for the shadow test if a large triangle passes close to the record.
    vec2 from_centre = gl_FragCoord.xy - v_centre;
    vec3 direction = v_ahead + from_centre.x * v_right + from_centre.y * v_up;
    vec4 plane = face_plane(gl_PrimitiveID);
    float kappa = plane.w - dot(plane.xyz, v_eye);
    vec3 g = kappa > 0.0 ? -plane.xyz : plane.xyz;  // on the side of the record
    bool inner = kappa > 0.0;
    kappa = -abs(kappa);
    float depth = kappa / min(dot(g, direction), -1e-20);
    vec3 to_hit = direction * depth;

    Receiver receiver = Receiver(v_eye + to_hit, shading_normal(point.normal, g), g, FLAT);
    vec3 E = direct_irradiance(receiver, 1, vec2(1.0, 0.0));
#if SURFACE
    E += surface_irradiance_at(gl_PrimitiveID, receiver.p, g).rgb;
#endif
    out_radiance = vec4(outgoing_radiance(material, E), max(length(to_hit), 0.05 * near));
    out_plane = vec4(g / min(kappa, -0.05 * near), inner && gl_PrimitiveID < closed ? -1.0 : 0.0);
}
