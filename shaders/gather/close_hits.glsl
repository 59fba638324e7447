// Two numbers in 0..1 in one float, 12 bits each: the share of a hit's radiance that comes from close values of the surface cache,
// and the reflectance that weights them.
const float TWELVE_BITS = 4095.0;

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
