// Radiance, exposed and tone-mapped.
#include "image/backdrop.glsl"
#include "viewer/buffers/picture.glsl"

uniform float gain;           // the exposure as a factor
uniform bool covers_unseen;   // true if the buffer also has values at pixels without a surface at their centre

vec3 picture(ivec2 pixel, float depth)
{
    return display((covers_unseen || depth > 0.0 ? texelFetch(values, pixel, 0).rgb : backdrop_radiance(vec2(pixel) + 0.5)) * gain);
}
