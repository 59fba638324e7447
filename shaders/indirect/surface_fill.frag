// Holes, while a view fills: the marked pixels take what the surface cache says.
#include "lib/octahedral.glsl"
#include "surface_cache/lookup.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform sampler2D albedo;
uniform sampler2D emission;
uniform int pixel_stride;    // pixels of the g-buffer per pixel drawn, in x and y

layout(location = 0) out vec4 out_sums;  // E/depth, 1/depth

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy) * pixel_stride;
    vec4 p = texelFetch(position, pixel, 0);
    vec3 g = octahedral_decode(vec2(texelFetch(normal, pixel, 0).w, texelFetch(albedo, pixel, 0).w));
    out_sums = vec4(surface_irradiance(int(texelFetch(emission, pixel, 0).w), p.xyz, g), 1.0) / p.w;
}
