// Fills holes: pixels that temporal.frag has marked take the irradiance of the surface cache (METHOD.md, 8.2).
#include "lib/gbuffer.glsl"
#include "lib/same_surface.glsl"
#include "surface_cache/lookup.glsl"

uniform int pixel_stride;    // pixels of the g-buffer per drawn pixel, in x and y

layout(location = 0) out vec4 out_sums;    // E/depth, 1/depth; depth in metres
layout(location = 1) out float out_facing;  // facing_of the normal

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy) * pixel_stride;
    vec4 p = texel_at(position, pixel);
    out_sums = vec4(surface_irradiance_at(triangle_at(pixel), p.xyz, geometric_normal_at(pixel)).rgb, 1.0) / p.w;
    out_facing = facing_of(texel_at(normal, pixel).xyz);
}
