// Fills the holes of a picture without probes: pixels without a record take the irradiance of the surface cache (METHOD.md, 8.2).
#include "generated/constants.glsl"
#include "lib/gbuffer.glsl"
#include "surface_cache/lookup.glsl"

uniform sampler2D sums;    // Σ k·E, Σ k of the records
uniform int pixel_stride;  // pixels of the g-buffer per pixel of the sums, in x and y

layout(location = 0) out vec4 out_sums;  // the records' sums, or E and 1; 0 without a surface

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), pixel = at * pixel_stride;
    out_sums = texel_at(sums, at);
    vec4 p = texel_at(position, pixel);
    if (out_sums.a > COVERED || p.w == 0.0) return;
    out_sums = vec4(surface_irradiance_at(triangle_at(pixel), p.xyz, geometric_normal_at(pixel)).rgb, 1.0);
}
