// Radiance, exposed and tone-mapped.
#include "image/backdrop.glsl"
#include "viewer/buffers/picture.glsl"

uniform float gain;           // the exposure as a factor
uniform bool covers_unseen;   // whether the buffer also holds values where the pixel's centre sees nothing

vec3 picture(ivec2 pixel, float depth)
{
    return display((covers_unseen || depth > 0.0 ? texelFetch(values, pixel, 0).rgb : backdrop_radiance(vec2(pixel) + 0.5)) * gain);
}
