// The radiance of virtual point lights (METHOD.md, 3.8): reflected direct light of their source. A fragment is a virtual light.
#include "lighting/lights.glsl"
#include "generated/vertex_table.glsl"
#include "lib/rays/triangles.glsl"
#include "lib/material.glsl"
#include "lib/material_table.glsl"
#include "lib/normals.glsl"

uniform sampler2D places;  // `virtual_places` of gather/light_samples/sample.glsl

layout(location = 0) out vec4 out_radiance;  // W/(m² sr)

void main()
{
    ivec2 at = ivec2(1, 3) * ivec2(gl_FragCoord.xy);
    vec4 position = texel_at(places, at), normal = texel_at(places, at + ivec2(0, 1));
    vec4 barycentric = texel_at(places, at + ivec2(0, 2));
    int triangle = int(barycentric.w);
    ivec3 number = triangle_vertices(triangle);
    Vertex A = vertex_at(number.x), B = vertex_at(number.y), C = vertex_at(number.z), point = interpolate(barycentric.xyz, A, B, C);
    Material material = material_mean(point, texture_area(1.0 / position.w, A, B, C));
    vec3 g = normal.xyz;
    vec3 E = light_irradiance(int(normal.w), Receiver(position.xyz, shading_normal(point.normal, g), g, FLAT));
    out_radiance = vec4(reflected_radiance(material, E), 0.0);
}
