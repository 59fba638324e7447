// The sums at a pixel, or, without a contributing record, of the pixels around it.
#include "generated/constants.glsl"

uniform sampler2D sums;    // Σ k·E, Σ k
uniform sampler2D centre;  // the same of the pixels' centres

// The pixel's own sums, or else the sum of its neighbours', or else those of its own centre. Records are made for pixels' centres alone, so
// that they may miss another sample of a pixel.
vec4 own_or_neighbouring_sums(ivec2 pixel)
{
    vec4 s = texelFetch(sums, pixel, 0);
    if (s.a > COVERED) return s;
    ivec2 last = textureSize(sums, 0) - 1;
    s = vec4(0.0);
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) s += texelFetch(sums, clamp(pixel + ivec2(x, y), ivec2(0), last), 0);
    return s.a > COVERED ? s : texelFetch(centre, pixel, 0);
}
