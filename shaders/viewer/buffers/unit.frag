// Values 0..1, sRGB encoded.
#include "viewer/buffers/picture.glsl"

uniform bool grey;  // true for one value per pixel, also for pixels without a surface at their centre

vec3 picture(ivec2 pixel, float depth)
{
    vec3 value = texelFetch(values, pixel, 0).rgb;
    return grey ? encoded(value.rrr) : depth > 0.0 ? encoded(value) : vec3(0.0);
}
