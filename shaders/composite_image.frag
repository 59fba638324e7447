// The blend: direct and indirect light in one radiometric unit, plus what surfaces and sky emit.
#include "lib/constants.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D albedo;
uniform sampler2D emission;
uniform sampler2D direct;
uniform sampler2D irradiance;
uniform vec2 blend;          // weights of direct and indirect
uniform vec3 sky;

layout(location = 0) out vec4 out_image;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    if (texelFetch(position, pixel, 0).w == 0.0)
    {
        out_image = vec4(sky, 1.0);
        return;
    }
    vec3 indirect = texelFetch(albedo, pixel, 0).rgb * INV_PI * texelFetch(irradiance, pixel, 0).rgb;
    vec3 light = blend.x * texelFetch(direct, pixel, 0).rgb + blend.y * indirect;
    out_image = vec4(light + texelFetch(emission, pixel, 0).rgb, 1.0);
}
