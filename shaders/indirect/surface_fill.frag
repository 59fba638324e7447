// Holes while a view fills: the marked pixels take the irradiance of the surface cache.
#include "lib/gbuffer.glsl"
#include "lib/same_surface.glsl"
#include "surface_cache/lookup.glsl"

uniform int pixel_stride;    // pixels of the g-buffer per pixel drawn, in x and y

layout(location = 0) out vec4 out_sums;    // E/depth, 1/depth
layout(location = 1) out float out_facing;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy) * pixel_stride;
    vec4 p = texel_at(position, pixel);
    out_sums = vec4(surface_irradiance_at(triangle_at(pixel), p.xyz, geometric_normal_at(pixel)).rgb, 1.0) / p.w;
    out_facing = facing_of(texel_at(normal, pixel).xyz);
}
