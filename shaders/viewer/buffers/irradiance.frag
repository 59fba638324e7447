// Irradiance as the radiance of a white surface, E/pi, so that it compares with the picture.
#include "viewer/buffers/picture.glsl"

uniform float gain;  // the exposure as a factor

vec3 picture(ivec2 pixel, float depth)
{
    vec4 s = texelFetch(values, pixel, 0);
    return s.a > 0.0 ? display(s.rgb / s.a * INV_PI * gain) : vec3(0.0);
}
