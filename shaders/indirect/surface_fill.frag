// Holes, while a view fills: the marked pixels take what the surface cache says.
#include "lib/octahedral.glsl"
#include "lib/texel.glsl"
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
    vec4 p = texel_at(position, pixel);
    vec3 g = octahedral_decode(vec2(texel_at(normal, pixel).w, texel_at(albedo, pixel).w));
    out_sums = vec4(surface_irradiance(int(texel_at(emission, pixel).w), p.xyz, g), 1.0) / p.w;
}
