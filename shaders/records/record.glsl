// A record of the cache, found by its number; irrsplat/core/record_layout.py lists its columns.
#include "generated/constants.glsl"
#include "generated/record_columns.glsl"
#include "lib/normals.glsl"
#include "lib/table.glsl"
#include "records/error_scale.glsl"

// Include records/weight.glsl before this file: it declares `hessian`.

// Where a record's error reaches the tolerated size: an ellipse in its tangent plane.
struct Ellipse
{
    vec3 axis;     // unit, along which it reaches farthest
    float along;   // radius along the axis, metres
    float across;  // radius across it, metres
};

// True if the record lies in the dark within a closed mesh, which is invisible: it contributes to its own pixel only.
bool record_enclosed(ivec2 texel)
{
#if GRADIENTS
    return record_max_radius(texel) == 0.0;
#else
    return false;
#endif
}

// The record's second derivatives along its axis and across it; 0 where they are not known or the weights are the paper's.
vec2 usable_curvature(ivec2 texel)
{
    return hessian && record_axis(texel) != vec3(0.0) ? record_curvature(texel) : vec2(0.0);
}

// The radii within which the record's own expansion holds, before they are scaled by a. With second derivatives, a·R is where the error of
// the first-order expansion, ½·|E''|·d², comes to a² of E's error scale: R = √(2·E/|E''|) (after Schwarzhaupt, Jensen and Jarosz 2012, "Practical
// Hessian-Based Error Control for Irradiance Caching"). Without, R is R_k, but at most E/|∇E| where the light changes fast (Křivánek et
// al. 2006).
Ellipse record_ellipse(ivec2 texel)
{
    vec3 n = record_normal(texel);
    vec3 axis = perpendicular(n);
    float R = record_radius(texel);
#if GRADIENTS
    float slope = length(record_gradient(texel) * LUMINANCE), Y = dot(record_irradiance(texel), LUMINANCE);
    if (record_axis(texel) != vec3(0.0))
    {
        // record_curvature is E''/Y, so that 2·E/|E''| is 2·(E/Y)/|curvature|
        float square = 2.0 * error_scale(Y) / max(Y, 1e-20);
        vec2 radii = sqrt(square / max(abs(record_curvature(texel)), 1e-14));
        radii = min(radii, record_max_radius(texel));
        if (hessian) return Ellipse(record_axis(texel), radii.x, radii.y);
        axis = record_axis(texel);  // the curvature is given along it, also where the ellipse is a circle
    }
    float E = max(Y, max(luminance_floor, 1e-20));
    R = slope * R > E ? E / slope : R;
#endif
    return Ellipse(axis, R, R);
}
