// The g-buffer: position, normals and material of the surface at each pixel's centre.
#include "generated/interpolated.glsl"
#include "image/texture_map.glsl"
#include "lib/material_table.glsl"
#include "lib/surface.glsl"

in vec3 v_position;

uniform vec3 eye;
uniform vec3 forward;        // unit, the view axis
uniform float far;           // metres, beyond the farthest corner of the scene
uniform int closed;          // triangles of lower numbers belong to closed meshes
uniform int first_triangle;  // number of the first triangle of this draw

// MASK, BLEND: 1 where the surface is there only where its opacity reaches the cutoff. MAPPED_NORMALS: 1 where any surface of the
// scene has a normal map. EMISSIVE: 1 where any emits.

const float BACK = 1.0 / 32.0;  // of the change of depth across a pixel: how far inner sides of closed meshes are moved back
const float MOST_BACK = 1e-3;   // of the far distance: the most of it

layout(location = 0) out vec4 out_position;  // xyz, depth along the view axis (0: nothing seen)
layout(location = 1) out vec4 out_normal;    // shading normal turned to the eye, geometric normal octahedral .x
layout(location = 2) out vec4 out_albedo;    // reflectance, geometric normal octahedral .y
layout(location = 3) out vec4 out_emission;  // emitted radiance, number of the triangle
#if MAPPED_NORMALS
layout(location = 4) out vec4 out_mapped_normal;  // shading normal bent by the normal map
#endif

void main()
{
    float depth = dot(v_position - eye, forward), slope = fwidth(depth);
    int triangle = first_triangle + gl_PrimitiveID;
    vec4 plane = face_plane(triangle);
    vec3 g = plane.xyz;
    vec3 size = abs(eye);
    // From an eye in its plane a triangle is invisible: its remaining fragments result from rounding of the eye's position.
    if (abs(dot(g, eye) - plane.w) <= EDGE_ON * max(max(size.x, size.y), size.z)) discard;
    g = gl_FrontFacing ? g : -g;  // turned to the eye by the rasteriser's judgement: at a silhouette a dot product is noise
    vec3 n = shading_normal(v_normal, g);
#if EMISSIVE
    Material material = material_factors(interpolated_vertex(v_position));
#else
    Material material = Material(max(v_albedo, 0.0), vec3(0.0));
#endif
    float alpha = v_opacity;
#if ALBEDO_MAP
    vec4 texel = albedo_texel(v_uv);
    material.albedo *= texel.rgb;
    alpha *= texel.a;
#endif
#if EMISSION_MAP
    material.emission *= map_texel(emission_map, emission_from_uv * v_uv + emission_place.xy, emission_place.zw).rgb;
#endif
#if MAPPED_NORMALS && NORMAL_MAP
    out_mapped_normal = vec4(mapped_normal(v_position, n, g, v_uv, gl_FrontFacing), 0.0);
#elif MAPPED_NORMALS
    out_mapped_normal = vec4(n, 0.0);
#endif
#if MASK || BLEND
    if (alpha < material_row(int(v_material), MATERIAL_EMISSION).w) discard;
#endif
    vec2 octahedral = octahedral_encode(g);
    out_position = vec4(v_position, max(depth, 1e-30));
    out_normal = vec4(n, octahedral.x);
    out_albedo = vec4(material.albedo, octahedral.y);
    out_emission = vec4(material.emission, float(triangle));
    // Linear depth is equally fine near and far, whatever the scene's size. From outside, the inner side of a closed mesh is never
    // visible. At a silhouette the rasteriser's rounding of corners makes depth noise: moved back, that side loses to the outer one.
    gl_FragDepth = depth / far + (!gl_FrontFacing && triangle < closed ? min(BACK * slope / far, MOST_BACK) : 0.0);
}
