// Add a probe to its cell if it lies on the surface there (METHOD.md, 8.2).
#include "lib/same_surface.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;  // of the cells: world space; w: depth, 0 without a surface
uniform sampler2D normal;    // of the cells
uniform sampler2D rest;      // of the cells: z is the state, see states.glsl
uniform float width;         // of a cell at distance 1, metres

flat in vec3 v_position;
flat in vec3 v_normal;
flat in vec4 v_light;

layout(location = 0) out vec4 out_light;  // E and 1
layout(location = 1) out vec2 out_near;   // 1/R and 1

const float REACH = 1.5;  // cells: greatest distance of a probe from the surface point of its cell

void main()
{
    ivec2 cell = ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(position, cell);
    vec3 n = texel_at(normal, cell).xyz;
    bool there = texel_at(rest, cell).z > 0.0 && distance(p.xyz, v_position) <= REACH * width * p.w;
    if (!there || !same_surface(p.xyz, n, v_position, v_normal)) discard;
    out_light = vec4(v_light.rgb, 1.0);
    out_near = vec2(1.0 / max(v_light.a, 1e-20), 1.0);
}
