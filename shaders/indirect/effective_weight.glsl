// The weight of a pixel as the examination counts it: a pixel needs a record where it is below the tolerance.
#include "generated/constants.glsl"
#include "records/error_scale.glsl"

uniform float tolerance;        // Σw below which a pixel needs a record in any case
uniform float spread;           // standard deviation of the records' luminances over their mean that is allowed (0: any)

const float NEAR = 3.0;   // times the tolerance: so great a Σw has only a pixel close to a record, which is then right about it

// Standard deviation and mean of the records' contributions at a pixel, as luminances: W/m².
vec2 deviation_and_mean(vec2 weight, vec4 sums)
{
    float k = max(sums.a, 1e-20), Y = dot(sums.rgb, LUMINANCE) / k;
    return vec2(sqrt(max(weight.g / k - Y * Y, 0.0)), Y);
}

// Σw, reduced by inter-record variance: below the tolerance where the deviation exceeds `spread`.
// weight: Σw and Σ k·(Y² - σ²). sums: Σ k·E, Σ k. Where only a share of the records' reach holds, as much of the spread is allowed, and Σw is
// that much greater: it counts by that share.
float effective_weight(vec2 weight, vec4 sums, float share)
{
    weight.r *= weight.r < NOTHING_SEEN ? share : 1.0;
    vec2 found = deviation_and_mean(weight, sums);
    bool inaccurate = weight.r < NEAR * tolerance && spread > 0.0 && found.x > 0.0;
    return inaccurate ? min(weight.r, tolerance * spread * share * error_scale(found.y) / found.x) : weight.r;
}
