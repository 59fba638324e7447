// The weight of a record for a point, kept finite by a least error.
#include "lib/constants.glsl"

uniform float a;

// LEAST_ERROR and IN_FRONT (of R_k: how far in front of a pixel's surface, or behind it, a record may lie) are settings.py's.

// How far away p is in radii of a record: `apart` = p - p_k in metres, R its radii along `axis` and across it in metres.
float record_distance(vec3 apart, vec3 axis, vec2 R)
{
    float along = dot(apart, axis), across = max(dot(apart, apart) - along * along, 0.0);
    return sqrt(along * along / (R.x * R.x) + across / (R.y * R.y));
}

// Whether p is beyond one of a record's two walls, of which each has coordinates along `axis` and across it in the tangent plane.
bool record_beyond(vec3 apart, vec3 axis, vec3 n_k, vec4 walls)
{
    vec2 place = vec2(dot(apart, axis), dot(apart, cross(n_k, axis)));
    return max(dot(place, walls.xy), dot(place, walls.zw)) > 1.0;
}

// The distance, and unit normals n of the point and n_k of the record; 0 where it does not speak.
float record_weight(vec3 apart, vec3 axis, vec2 R, vec3 n, vec3 n_k, bool in_front)
{
    float cosine = dot(n, n_k);
    if (in_front && (cosine <= 0.0 || abs(dot(apart, n + n_k)) * 0.5 > IN_FRONT * R.y)) return 0.0;
    return 1.0 / max(record_distance(apart, axis, R) + sqrt(max(0.0, 1.0 - cosine)), LEAST_ERROR);
}

// What a record says of the light at p: Taylor's expansion about it, of second order where it is known. E: n·M. slope: ∇E·apart.
// bend: second derivatives along `axis` and across it, in the tangent plane of n_k, as shares of the light, in 1/m².
// There is no extrapolation below black or beyond twice E, and by bends at most by half.
vec3 record_says(vec3 E, vec3 slope, vec3 apart, vec3 n_k, vec3 axis, vec2 bend)
{
    float up = dot(apart, n_k), along = dot(apart, axis), across = max(dot(apart, apart) - up * up - along * along, 0.0);
    float more = clamp(0.5 * (bend.x * along * along + bend.y * across), -0.5, 0.5);
    return clamp(E + slope + more * E, vec3(0.0), max(2.0 * E, 0.0));
}
