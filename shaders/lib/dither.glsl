// Dither noise: it decides if a value is rounded up or down, so that the mean over several pixels is correct.

// Return interleaved gradient noise in 0..1 at a pixel (Jimenez 2014). Its low values are spread evenly.
float dither(vec2 pixel)
{
    return fract(52.9829189 * fract(dot(mod(floor(pixel), 512.0), vec2(0.06711056, 0.00583715))));
}
