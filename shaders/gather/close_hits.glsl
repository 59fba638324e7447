// Two numbers in 0..1 in one float, 12 bits each: the share of a hit's radiance that comes from close values of the surface cache,
// and the reflectance that weights them.
#include "generated/constants.glsl"

float joined(vec2 pair)
{
    pair = floor(clamp(pair, 0.0, 1.0) * TWELVE_BITS + 0.5);
    return pair.x * (TWELVE_BITS + 1.0) + pair.y;
}

vec2 parted(float both)
{
    float first = floor(both / (TWELVE_BITS + 1.0));
    return vec2(first, both - first * (TWELVE_BITS + 1.0)) / TWELVE_BITS;
}

// Length of rays from which the value at a hit holds, in extents of its surface: of a record's rays, and of rays from close hits.
const vec2 CLOSE = vec2(2.0, 1.0);
