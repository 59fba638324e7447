// The effective weight of a pixel: a pixel requests a record if it is below the tolerance (METHOD.md, 7.1).
#include "generated/constants.glsl"
#include "records/error_scale.glsl"

uniform float tolerance;        // Σw below which a pixel always requests a record
uniform float spread;           // allowed standard deviation of the records' luminances, divided by the error scale (0: any)

const float NEAR = 3.0;   // in tolerances: with a greater Σw, a pixel is so close to a record that variance does not count

// Return standard deviation and mean of the luminances, W/m², that the records contribute at a pixel.
vec2 deviation_and_mean(vec2 weight, vec4 sums)
{
    float k = max(sums.a, 1e-20), Y = dot(sums.rgb, LUMINANCE) / k;
    return vec2(sqrt(max(weight.g / k - Y * Y, 0.0)), Y);
}

// Return Σw, reduced by inter-record variance: below the tolerance if the deviation exceeds `spread`.
// weight: Σw and Σ k·(Y² - σ²). sums: Σ k·E, Σ k. share: the valid share of the records' reach at the pixel (METHOD.md, 8.3).
// It is also a factor on Σw and on the allowed spread.
float effective_weight(vec2 weight, vec4 sums, float share)
{
    weight.r *= weight.r < NOTHING_SEEN ? share : 1.0;
    vec2 deviation = deviation_and_mean(weight, sums);
    bool limited = weight.r < NEAR * tolerance && spread > 0.0 && deviation.x > 0.0;
    return limited ? min(weight.r, tolerance * spread * share * error_scale(deviation.y) / deviation.x) : weight.r;
}
