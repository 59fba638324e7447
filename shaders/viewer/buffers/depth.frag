// The depth along the view axis by the colour map.
#include "viewer/buffers/picture.glsl"

uniform float low;   // metres: the depth at the first colour
uniform float high;  // metres: the depth at the last colour

vec3 picture(ivec2 pixel, float depth)
{
    return depth > 0.0 ? heat((texelFetch(values, pixel, 0).w - low) / (high - low)) : vec3(0.0);
}
