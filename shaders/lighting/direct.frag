// Direct light per pixel, with four dithered shadow samples per light (Jones 2010, 2.4, 3.3; METHOD.md, 9.2). SHADOW_MARKS: 1 if
// the depth buffer marks pixels with different samples. SHADOW_RAYS: 1 for the second draw, where rays decide these pixels.
#include "lib/gbuffer.glsl"
#include "lighting/lights.glsl"
#include "lib/material.glsl"
#if SHADOW_RAYS
#include "generated/vertex_table.glsl"
#include "lib/rays/triangles.glsl"
#endif

#if NORMAL_MAPS
uniform sampler2D lit_normal;  // unit normal with the normal map
#endif
uniform ivec2 picture_corner; // first pixel of this part, in the whole picture
uniform float rotation;      // rotation of the pattern of the four samples, radians

const float SMOOTH = 0.99999;  // cosine between geometric and interpolated normal; below it, facets approximate a curve

#if SHADOW_RAYS
uniform int lit;             // triangles of lower numbers can be hit by light

// Return the position on the curved surface that facets approximate, for a point p of a facet: the mean of the projections of p
// onto the tangent planes at the corners (Hanika 2021, "Hacking the Shadow Terminator"). Concave surfaces do not change.
vec3 curved_position(vec3 p, vec3 n, int triangle)
{
    vec3 corner[3] = vec3[](triangle_point(triangle, 0), triangle_point(triangle, 1), triangle_point(triangle, 2));
    ivec3 numbers = triangle_vertices(triangle);
    vec3 area = cross(corner[1] - corner[0], corner[2] - corner[0]), curved = p;
    for (int k = 0; k < 3; ++k)
    {
        vec3 m = shading_normal(vertex_at(numbers[k]).normal, n), b = corner[(k + 1) % 3] - p, c = corner[(k + 2) % 3] - p;
        float weight = clamp(dot(cross(b, c), area) / dot(area, area), 0.0, 1.0);
        curved -= weight * min(dot(p - corner[k], m), 0.0) * m;
    }
    return curved;
}
#endif

layout(location = 0) out vec4 out_direct;  // outgoing radiance ρ/π·E, or with IRRADIANCE E; a: 1 at a surface, else 0

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(position, pixel), n = texel_at(normal, pixel);
    out_direct = vec4(0.0);
#if SHADOW_MARKS
    gl_FragDepth = 0.0;
#endif
    if (p.w == 0.0) return;
    // interleaved gradient noise (Jimenez 2014) rotates the pattern per pixel
    float angle = 2.0 * PI * fract(52.9829189 * fract(dot(gl_FragCoord.xy + vec2(picture_corner), vec2(0.06711056, 0.00583715)))) + rotation;
    vec3 m = n.xyz;
#if NORMAL_MAPS
    m = texel_at(lit_normal, pixel).xyz;
#endif
    vec3 g = geometric_normal_at(pixel);
    Receiver receiver = Receiver(p.xyz, m, g, FLAT);
    if (dot(n.xyz, g) < SMOOTH)
    {
#if SHADOW_RAYS
        int triangle = triangle_at(pixel);
        if (triangle < lit) receiver.p = curved_position(p.xyz, n.xyz, triangle);
        receiver.g = n.xyz;
#else
        receiver.rise = CURVED;
#if SHADOW_MARKS
        undecided = true;
#endif
#endif
    }
    vec3 E = direct_irradiance(receiver, 4, vec2(cos(angle), sin(angle)));
#ifdef IRRADIANCE
    out_direct = vec4(E, 1.0);
#else
    out_direct = vec4(reflected_radiance(material_at(pixel), E), 1.0);
#endif
#if SHADOW_MARKS
    gl_FragDepth = undecided ? 1.0 : 0.0;
#endif
}
