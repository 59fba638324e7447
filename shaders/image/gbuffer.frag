// The g-buffer: position, normals and material of what each pixel sees at its centre.
#include "generated/interpolated.glsl"
#include "lib/material_table.glsl"
#include "lib/octahedral.glsl"
#include "lib/surface.glsl"

in vec3 v_position;

uniform vec3 eye;
uniform vec3 forward;   // unit, the view axis
uniform float far;      // metres, beyond the farthest corner of the scene

uniform int closed;     // triangles of lower numbers belong to closed meshes

const float BACK = 1e-3;  // how far inner sides of closed meshes are moved back, as a share of the far distance

layout(location = 0) out vec4 out_position;  // xyz, depth along the view axis (0: nothing seen)
layout(location = 1) out vec4 out_normal;    // shading normal turned to the eye, geometric normal octahedral .x
layout(location = 2) out vec4 out_albedo;    // reflectance, geometric normal octahedral .y
layout(location = 3) out vec4 out_emission;  // emitted radiance, number of the triangle

void main()
{
    float depth = dot(v_position - eye, forward);
    vec3 g = face_plane(gl_PrimitiveID).xyz;
    g = gl_FrontFacing ? g : -g;  // turned to the eye by the rasteriser's judgement: at a silhouette a dot product is noise
    vec3 n = shading_normal(v_normal, g);
    Material material = material_of(interpolated_vertex(v_position));
    vec2 octahedral = octahedral_encode(g);
    out_position = vec4(v_position, max(depth, 1e-30));
    out_normal = vec4(n, octahedral.x);
    out_albedo = vec4(material.albedo, octahedral.y);
    out_emission = vec4(material.emission, float(gl_PrimitiveID));
    // Linear depth is equally fine near and far, whatever the scene's size. From outside, the inner side of a closed mesh is never
    // visible, but at a silhouette depth is noise: moved back, it loses to the outer side.
    gl_FragDepth = depth / far + (!gl_FrontFacing && gl_PrimitiveID < closed ? BACK : 0.0);
}
