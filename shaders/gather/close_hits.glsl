// Close hits of a record's rays (METHOD.md, 11.5). One float stores two numbers of a hit in 0..1, 12 bits each: the share of its
// radiance that comes from a close value of the surface cache, and the reflectance that weights this value.
#include "generated/constants.glsl"

// Return two numbers in 0..1 as one float.
float pack_pair(vec2 pair)
{
    pair = floor(clamp(pair, 0.0, 1.0) * TWELVE_BITS + 0.5);
    return pair.x * (TWELVE_BITS + 1.0) + pair.y;
}

// Return the two numbers of a float from pack_pair.
vec2 unpack_pair(float value)
{
    float first = floor(value / (TWELVE_BITS + 1.0));
    return vec2(first, value - first * (TWELVE_BITS + 1.0)) / TWELVE_BITS;
}

// Greatest length of rays to close hits, in extents of the value's surface: rays of records, and rays from close hits.
const vec2 CLOSE = vec2(2.0, 1.0);
