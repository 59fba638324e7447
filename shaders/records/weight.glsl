// The weight of a record at a point, and the irradiance that it extrapolates there. irrsplat/records/weight.py and
// merge.py have the same in numpy.
#include "generated/constants.glsl"

uniform float a;       // the error that is tolerated (Ward et al. 1988)
uniform bool hessian;  // weights and radii are by second derivatives; else the paper's, by the harmonic mean distance

const float FAINT = 0.1;        // of a record's luminance: below it, the expansion is not valid

// Constants from irrsplat/records/weight.py: LEAST_ERROR keeps the weight finite; IN_FRONT is how far in front of the point's surface or
// behind it a record may lie, as a share of R; LUNES is the share of (1 - n·n_k)·E that n·M lacks on a surface turned to n.

// How far p is from a record in radii: apart = p - p_k in metres; R: radii along `axis` and across it, metres.
float record_distance(vec3 apart, vec3 axis, vec2 R)
{
    float along = dot(apart, axis), across = max(dot(apart, apart) - along * along, 0.0);
    return sqrt(along * along / (R.x * R.x) + across / (R.y * R.y));
}

// Ward et al. 1988: w = 1/(|p - p_k|/R + √(1 - n·n_k)); n, n_k: unit normals of the point and of the record. By the Hessian, 0
// for a record that faces away, or lies in front of the point's surface or behind it.
float record_weight(vec3 apart, vec3 axis, vec2 R, vec3 n, vec3 n_k)
{
    float cosine = dot(n, n_k);
    if (hessian && (cosine <= 0.0 || abs(dot(apart, n + n_k)) * 0.5 > IN_FRONT * R.y)) return 0.0;
    return 1.0 / max(record_distance(apart, axis, R) + sqrt(max(0.0, 1.0 - cosine)), LEAST_ERROR);
}

// The irradiance on a surface of unit normal n by a record's irradiance vectors M, whose own normal is n_k: W/m². n·M counts light
// below the surface as negative, and lacks what n_k's own surface hides from the record: of even light both are half of
// (1 - n·n_k)·E_k. The first is seen; the second is taken for half as bright (docs/METHOD.md, 4.1).
vec3 turned(mat3 M, vec3 n, vec3 n_k)
{
    return n * M + LUNES * (1.0 - dot(n, n_k)) * (n_k * M);
}

// The irradiance at p by a Taylor expansion about the record (Ward and Heckbert 1992), of second order where that is known.
// E: turned() to the point's normal, W/m². slope: ∇E·apart, W/m². curvature: second derivatives along `axis` and across it in the
// tangent plane of n_k, as shares of the irradiance, 1/m². The second-order term changes E by at most half, and the result lies
// between black and 2·E.
vec3 extrapolated(vec3 E, vec3 slope, vec3 apart, vec3 n_k, vec3 axis, vec2 curvature)
{
    float up = dot(apart, n_k), along = dot(apart, axis), across = max(dot(apart, apart) - up * up - along * along, 0.0);
    float more = clamp(0.5 * (curvature.x * along * along + curvature.y * across), -0.5, 0.5);
    return clamp(E + slope + more * E, vec3(0.0), max(2.0 * E, 0.0));
}

// The share of its weight that a record has where extrapolated() makes of its luminance Y_k only Y. The share is nearly 0 a
// few pixels from a contact, where light falls steeply: the expansion ends there, and the place is not dark.
float known_share(float Y_k, float Y)
{
    return Y_k > 0.0 ? clamp(Y / (FAINT * Y_k), 1e-3, 1.0) : 1.0;
}
