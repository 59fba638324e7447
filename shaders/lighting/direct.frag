// Direct light at every pixel.
#include "lighting/direct_light.glsl"
#include "lib/material.glsl"

uniform sampler2D position;  // g-buffer

layout(location = 0) out vec4 out_direct;  // outgoing radiance ρ/π·E, or with IRRADIANCE E itself; a: 1 where a surface is seen

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(position, pixel);
    out_direct = vec4(0.0);
    if (p.w == 0.0) return;
    vec3 E = direct_irradiance_at(pixel, p.xyz);
#ifdef IRRADIANCE
    out_direct = vec4(E, 1.0);
#else
    out_direct = vec4(reflected_radiance(material_at(pixel), E), 1.0);
#endif
}
