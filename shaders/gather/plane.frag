// Radiance that leaves the surface towards the record along the ray of each texel: emission and shadow-mapped direct light.
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

uniform float near;  // metres
uniform int closed;  // triangles of lower numbers belong to closed meshes

flat in vec2 v_centre;
flat in vec3 v_eye;
flat in vec3 v_right;
flat in vec3 v_up;
flat in vec3 v_ahead;

layout(location = 0) out vec4 out_radiance;  // rgb W/(m² sr), a distance in metres (0: nothing hit, the sky)
layout(location = 1) out vec4 out_plane;     // of the hit triangle: 1/distance in the unit direction w is dot(xyz, w), metres⁻¹; w: 1 on
                                             // the inner side of a closed mesh

void main()
{
    Vertex point = interpolated_vertex(vec3(0.0));
    vec4 u = dFdx(point.uv), v = dFdy(point.uv);  // from texel to texel
    Material material = material_mean(point, abs(vec2(u.x * v.y - u.y * v.x, u.z * v.w - u.w * v.z)));
#if CUT_OUTS
    if (light_passes(point)) discard;
#endif
    // The surface's place by intersection of the texel's ray with the triangle's plane: an interpolated one is too coarse for
    // the shadow test where a large triangle passes close to the record.
    vec2 from_centre = gl_FragCoord.xy - v_centre;
    vec3 q = v_ahead + from_centre.x * v_right + from_centre.y * v_up;
    vec4 plane = face_plane(gl_PrimitiveID);
    float k = plane.w - dot(plane.xyz, v_eye);
    vec3 g = k > 0.0 ? -plane.xyz : plane.xyz;  // turned to the record
    bool inner = k > 0.0;
    k = -abs(k);
    float depth = k / min(dot(g, q), -1e-20);
    vec3 away = q * depth;

    Receiver receiver = Receiver(v_eye + away, shading_normal(point.normal, g), g, FLAT);
    vec3 E = direct_irradiance(receiver, 1, vec2(1.0, 0.0));
#if SURFACE
    E += surface_irradiance_at(gl_PrimitiveID, receiver.p, g).rgb;
#endif
    out_radiance = vec4(outgoing_radiance(material, E), max(length(away), 0.05 * near));
    out_plane = vec4(g / min(k, -0.05 * near), inner && gl_PrimitiveID < closed ? -1.0 : 0.0);
}
