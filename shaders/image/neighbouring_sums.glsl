// The sums at a pixel of whose light no record tells: those of the pixels around it.
#include "generated/constants.glsl"

uniform sampler2D sums;    // Σ k·E, Σ k
uniform sampler2D centre;  // the same of the pixels' centres

// The sum of the neighbours' sums, or else those of the pixel's own centre. Records are made for pixels' centres alone, so that they may
// miss another sample of a pixel.
vec4 neighbouring_sums(ivec2 pixel)
{
    ivec2 last = textureSize(sums, 0) - 1;
    vec4 s = vec4(0.0);
    for (int y = -1; y <= 1; ++y)
        for (int x = -1; x <= 1; ++x) s += texelFetch(sums, clamp(pixel + ivec2(x, y), ivec2(0), last), 0);
    return s.a > TOLD ? s : texelFetch(centre, pixel, 0);
}
