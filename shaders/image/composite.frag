// The picture: irradiance from the sums, and with it the outgoing radiance of direct light, indirect light, emission and sky.
#include "generated/gbuffer_material.glsl"
#include "image/filtered.glsl"
#include "lib/material.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D direct;
uniform sampler2D sums;      // Σ k·E, Σ k; after smoothing E and 1
uniform vec2 blend;          // weights of direct and indirect light

layout(location = 0) out vec4 out_image;
layout(location = 1) out float out_alpha;  // 1 where a surface is seen, else what filters hold back

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 s = texelFetch(sums, pixel, 0);
    vec3 E = s.a > 0.0 ? s.rgb / s.a : vec3(0.0);
    Material material = material_at(pixel);
    vec3 indirect = reflected_radiance(material, E);
    vec3 light = blend.x * texelFetch(direct, pixel, 0).rgb + blend.y * indirect + material.emission;
    bool seen = texelFetch(position, pixel, 0).w > 0.0;
    out_image = vec4(seen ? filtered(pixel, light) : filtered_backdrop(pixel, gl_FragCoord.xy), 1.0);
    out_alpha = seen ? 1.0 : held_back(pixel);
}
