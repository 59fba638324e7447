// The weight of a record at a point, and the irradiance that the record extrapolates to this point (METHOD.md, 4.1, 4.6, 5.1,
// 5.2). irrsplat/records/weight.py and merge.py have NumPy versions.
#include "generated/constants.glsl"

uniform float a;       // the tolerated error (Ward et al. 1988)
uniform bool hessian;  // true if second derivatives define weights and radii; false: the harmonic mean distance, as in the paper

const float FAINT = 0.1;  // least valid luminance of an extrapolation, as a share of the record's luminance

// Constants from irrsplat/records/weight.py. LEAST_ERROR keeps the weight finite. IN_FRONT is the greatest distance of a record
// in front of or behind the point's surface, as a share of R. LUNES is the share of (1 - n·n_k)·E that n·M lacks at a normal n.

// Return the distance of p from a record in radii. offset: p - p_k, metres. R: radii along `axis` and across it, metres.
float record_distance(vec3 offset, vec3 axis, vec2 R)
{
    float along = dot(offset, axis), across = max(dot(offset, offset) - along * along, 0.0);
    return sqrt(along * along / (R.x * R.x) + across / (R.y * R.y));
}

// Return the weight w = 1/(|p - p_k|/R + √(1 - n·n_k)) (Ward et al. 1988). n, n_k: unit normals of the point and of the record.
// With `hessian`, the weight is 0 if the record faces away, or lies in front of the point's surface or behind it.
float record_weight(vec3 offset, vec3 axis, vec2 R, vec3 n, vec3 n_k)
{
    float cosine = dot(n, n_k);
    if (hessian && (cosine <= 0.0 || abs(dot(offset, n + n_k)) * 0.5 > IN_FRONT * R.y)) return 0.0;
    return 1.0 / max(record_distance(offset, axis, R) + sqrt(max(0.0, 1.0 - cosine)), LEAST_ERROR);
}

// Return the irradiance at unit normal n, W/m², by the irradiance vectors M of a record with normal n_k. n·M counts the light of
// one lune as negative, and lacks the light of another lune, below the record's surface. For uniform light, each lune has half of
// (1 - n·n_k)·E_k. The light of the first lune is known; the second lune counts as half as bright (METHOD.md, 4.1).
vec3 rotated_irradiance(mat3 M, vec3 n, vec3 n_k)
{
    return n * M + LUNES * (1.0 - dot(n, n_k)) * (n_k * M);
}

// Return the irradiance at p, W/m², by a Taylor expansion about the record (Ward and Heckbert 1992; second order: METHOD.md,
// 4.6). E: rotated_irradiance() at the point's normal. slope: ∇E·offset, W/m². curvature: second derivatives along `axis` and
// across it in the tangent plane of n_k, as shares of the irradiance, 1/m². Clamps limit the second-order term to half of E, and
// the result to 0..2·E.
vec3 extrapolated_irradiance(vec3 E, vec3 slope, vec3 offset, vec3 n_k, vec3 axis, vec2 curvature)
{
    float height = dot(offset, n_k), along = dot(offset, axis), across = max(dot(offset, offset) - height * height - along * along, 0.0);
    float second_order = clamp(0.5 * (curvature.x * along * along + curvature.y * across), -0.5, 0.5);
    return clamp(E + slope + second_order * E, vec3(0.0), max(2.0 * E, 0.0));
}

// Return a factor on a record's weight: small if extrapolation reduces its luminance Y_k to a small Y. A few pixels from a
// contact, light falls so steeply that the expansion reaches black too early.
float weight_factor(float Y_k, float Y)
{
    return Y_k > 0.0 ? clamp(Y / (FAINT * Y_k), 1e-3, 1.0) : 1.0;
}
