// Records of the cache, by texel (METHOD.md, 4.7 and 5.3). irrsplat/core/record_layout.py lists the columns.
#include "generated/constants.glsl"
#include "generated/record_columns.glsl"
#include "lib/normals.glsl"
#include "lib/table.glsl"
#include "records/error_scale.glsl"

// Include records/weight.glsl before this file, because it declares `hessian`.

// The ellipse in a record's tangent plane at which the estimated error reaches the tolerance.
struct Ellipse
{
    vec3 axis;     // unit vector of the longer half axis
    float along;   // radius along the axis, metres
    float across;  // radius across it, metres
};

// Return true if the record lies in the dark within a closed mesh (METHOD.md, 7.1): it may cover only its own pixel.
bool record_enclosed(ivec2 texel)
{
#if GRADIENTS
    return record_max_radius(texel) == 0.0;
#else
    return false;
#endif
}

// Return the second derivatives along the record's axis and across it, as shares of the irradiance, 1/m²; 0 if unknown, or
// without `hessian`.
vec2 usable_curvature(ivec2 texel)
{
    return hessian && record_axis(texel) != vec3(0.0) ? record_curvature(texel) : vec2(0.0);
}

// Return the radii R of a record, before the factor a. With second derivatives, the error of the first-order expansion,
// ½·|E''|·d², reaches a² of the error scale at d = a·R: R = √(2·E/|E''|) (after Schwarzhaupt, Jensen and Jarosz 2012, "Practical
// Hessian-Based Error Control for Irradiance Caching"). Without second derivatives, R is R_k, and at most E/|∇E| (Křivánek et al.
// 2006).
Ellipse record_ellipse(ivec2 texel)
{
    vec3 n = record_normal(texel);
    vec3 axis = perpendicular(n);
    float R = record_radius(texel);
#if GRADIENTS
    float slope = length(record_gradient(texel) * LUMINANCE), Y = dot(record_irradiance(texel), LUMINANCE);
    if (record_axis(texel) != vec3(0.0))
    {
        // record_curvature is E''/Y, so that 2·E/|E''| = 2·(E/Y)/|curvature|
        float square = 2.0 * error_scale(Y) / max(Y, 1e-20);
        vec2 radii = sqrt(square / max(abs(record_curvature(texel)), 1e-14));
        radii = min(radii, record_max_radius(texel));
        if (hessian) return Ellipse(record_axis(texel), radii.x, radii.y);
        axis = record_axis(texel);  // the curvature refers to this axis, even for a circle
    }
    float E = max(Y, max(luminance_floor, 1e-20));
    R = slope * R > E ? E / slope : R;
#endif
    return Ellipse(axis, R, R);
}
