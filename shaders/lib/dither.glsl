// Noise by which values are rounded up or down, so that their mean over some pixels is right.

// Interleaved gradient noise, 0..1 (Jimenez 2014): low values are spread evenly.
float dither(vec2 place)
{
    return fract(52.9829189 * fract(dot(mod(floor(place), 512.0), vec2(0.06711056, 0.00583715))));
}
