// Values 0..1, sRGB encoded.
#include "viewer/buffers/picture.glsl"

vec3 picture(ivec2 pixel, float depth)
{
    return depth > 0.0 ? encoded(texelFetch(values, pixel, 0).rgb) : vec3(0.0);
}
