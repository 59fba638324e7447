// Fills holes: pixels that mark.frag has marked, and that fill.frag has left, take the irradiance of the surface cache (METHOD.md, 8.2).
#include "lib/gbuffer.glsl"
#include "surface_cache/lookup.glsl"

uniform int pixel_stride;  // pixels of the g-buffer per pixel of the sums, in x and y

layout(location = 0) out vec4 out_sums;  // E and 1

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy) * pixel_stride;
    vec3 p = texel_at(position, pixel).xyz;
    out_sums = vec4(surface_irradiance_at(triangle_at(pixel), p, geometric_normal_at(pixel)).rgb, 1.0);
}
