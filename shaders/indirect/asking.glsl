// Which pixels ask for a record: those that too little weight speaks for, and those for which records contradict each other.
#include "lib/constants.glsl"

uniform float tolerance;  // Σw below which a pixel asks in any case
uniform float dark;       // W/m²: what is darker may be off by as much
uniform float spread;     // standard deviation of the records' luminances over their mean, beyond which it asks (0: never)

const float NEAR = 3.0;   // times the tolerance: so much weight has a pixel close to a record, which is then right about it

// Σw, or less where records contradict each other, so that it is below the tolerance where they do by more than `spread`.
// weight: Σw and Σ k·Y². sums: Σ k·E, Σ k.
float counted_weight(vec2 weight, vec4 sums)
{
    float k = max(sums.a, 1e-20), Y = dot(sums.rgb, LUMINANCE) / k;
    float off = sqrt(max(weight.g / k - Y * Y, 0.0));
    bool doubted = weight.r < NEAR * tolerance && spread > 0.0 && off > 0.0;
    return doubted ? min(weight.r, tolerance * spread * max(Y, dark) / off) : weight.r;
}
