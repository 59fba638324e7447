// Outputs of vertex shaders that draw records with indirect/splat.frag. Positions are in world space, in metres.
#include "records/view_radius.glsl"

flat out vec3 v_position;   // position p_k
flat out vec3 v_normal;  // unit normal n_k
flat out vec3 v_axis;    // unit axis of the ellipse
flat out vec2 v_radii;   // R along the axis and across it, within the bounds of the view, metres
flat out float v_factor;  // factor on the kernel k
flat out float v_signal;   // 1 - ν², the share of Y² without the variance of the noise
#if GRADIENTS
flat out vec2 v_curvature;  // second derivatives as shares of the irradiance, 1/m²
flat out mat3 v_m;          // irradiance vectors M, W/m²
flat out mat3 v_g;          // gradients ∇E, W/m³
#else
flat out vec3 v_irradiance;  // E, W/m²
#endif

const float ENCLOSED_SHARE = 1e-20;  // factor on the kernel of enclosed records: any other record outweighs them

// Pass the record at `texel` to the fragment shader. ellipse, trust: from view_ellipse.
void pass_record(ivec2 texel, Ellipse ellipse, float trust)
{
    v_position = record_position(texel);
    v_normal = record_normal(texel);
    v_axis = ellipse.axis;
    v_radii = vec2(ellipse.along, ellipse.across) / a;
    v_factor = record_enclosed(texel) ? ENCLOSED_SHARE : 1.0;
    v_signal = 1.0 - record_noise(texel) * record_noise(texel);
#if GRADIENTS
    v_m = record_vectors(texel);
    // derivatives are valid within the record's radius; if the least radius of the view is greater, they are scaled down
    v_g = record_gradient(texel) * trust;
    v_curvature = usable_curvature(texel) * trust * trust;
#else
    v_irradiance = record_irradiance(texel);
#endif
}
