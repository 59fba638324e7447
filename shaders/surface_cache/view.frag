// Value of the surface cache at every pixel.
#include "lib/octahedral.glsl"
#include "surface_cache/lookup.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform sampler2D albedo;
uniform sampler2D emission;

layout(location = 0) out vec4 out_irradiance;  // W/m², 1 where a surface is seen

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 p = texelFetch(position, pixel, 0);
    vec3 g = octahedral_decode(vec2(texelFetch(normal, pixel, 0).w, texelFetch(albedo, pixel, 0).w));
    out_irradiance = vec4(0.0);
    if (p.w > 0.0) out_irradiance = vec4(surface_irradiance_at(int(texelFetch(emission, pixel, 0).w), p.xyz, g).rgb, 1.0);
}
