// Vectors between two ends, with x, y, z as red, green, blue.
#include "viewer/buffers/picture.glsl"

uniform vec3 low;   // vectors of colours 0 and 1
uniform vec3 high;

vec3 picture(ivec2 pixel, float depth)
{
    return depth > 0.0 ? (texelFetch(values, pixel, 0).rgb - low) / (high - low) : vec3(0.0);
}
