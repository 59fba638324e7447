// The g-buffer (Jones 2010, 3.2): position, normals and material of the surface at each pixel's centre.
#include "generated/interpolated.glsl"
#include "image/texture_map.glsl"
#include "lib/material_table.glsl"
#include "lib/surface.glsl"

in vec3 v_position;

uniform vec3 eye;            // world space, metres
uniform vec3 forward;        // unit, the view axis
uniform float far;           // depth beyond the farthest corner of the scene, metres
uniform int first_triangle;  // number of the first triangle of this draw

// MASK, BLEND: 1 for surfaces that are visible only if their opacity reaches the cutoff. MAPPED_NORMALS: 1 if any surface has a
// normal map. EMISSIVE: 1 if any surface emits.

const float BACK = 1.0 / 32.0;  // offset of back faces, as a share of the change of depth per pixel
const float MOST_BACK = 1e-3;   // greatest offset, as a share of `far`

layout(location = 0) out vec4 out_position;  // xyz, depth along the view axis, metres (0: no surface)
layout(location = 1) out vec4 out_normal;    // shading normal on the eye's side; w: octahedral x of the geometric normal
layout(location = 2) out vec4 out_albedo;    // reflectance; w: octahedral y of the geometric normal
layout(location = 3) out vec4 out_emission;  // emitted radiance, number of the triangle
#if MAPPED_NORMALS
layout(location = 4) out vec4 out_mapped_normal;  // shading normal with the normal map
#endif

void main()
{
    float depth = dot(v_position - eye, forward), slope = fwidth(depth);
    int triangle = first_triangle + gl_PrimitiveID;
    vec4 plane = face_plane(triangle);
    vec3 g = plane.xyz;
    vec3 size = abs(eye);
    // A triangle is invisible from an eye in its plane: its fragments result from rounding of the eye's position.
    if (abs(dot(g, eye) - plane.w) <= EDGE_ON * max(max(size.x, size.y), size.z)) discard;
    g = gl_FrontFacing ? g : -g;  // by gl_FrontFacing, because a dot product is noise at silhouettes
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
    // Linear depth is equally precise at all distances and scales. From outside, the inner side of a solid is invisible. At
    // silhouettes, the rasteriser's rounding of corners makes depth noise, so that an offset moves the inner side behind the
    // outer one. Two equal solids at one place are no closed mesh, so that the offset moves all back faces.
    gl_FragDepth = depth / far + (gl_FrontFacing ? 0.0 : min(BACK * slope / far, MOST_BACK));
}
