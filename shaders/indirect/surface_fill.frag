// Holes while a view fills: the marked pixels take the irradiance of the surface cache.
#include "lib/octahedral.glsl"
#include "lib/same_surface.glsl"
#include "lib/texel.glsl"
#include "surface_cache/lookup.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform sampler2D albedo;
uniform sampler2D emission;
uniform int pixel_stride;    // pixels of the g-buffer per pixel drawn, in x and y

layout(location = 0) out vec4 out_sums;    // E/depth, 1/depth
layout(location = 1) out float out_facing;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy) * pixel_stride;
    vec4 p = texel_at(position, pixel);
    vec4 n = texel_at(normal, pixel);
    vec3 g = octahedral_decode(vec2(n.w, texel_at(albedo, pixel).w));
    out_sums = vec4(surface_irradiance_at(int(texel_at(emission, pixel).w), p.xyz, g).rgb, 1.0) / p.w;
    out_facing = facing_of(n.xyz);
}
