// The value of the surface cache at each pixel.
#include "lib/gbuffer.glsl"
#include "surface_cache/lookup.glsl"

layout(location = 0) out vec4 out_irradiance;  // rgb: W/m²; a: 1 at a surface, else 0

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(position, pixel);
    out_irradiance = vec4(0.0);
    if (p.w > 0.0) out_irradiance = vec4(surface_irradiance_at(triangle_at(pixel), p.xyz, geometric_normal_at(pixel)).rgb, 1.0);
}
