// The outputs of vertex shaders that draw records with indirect/splat.frag.
#include "records/view_radius.glsl"

flat out vec3 v_place;   // p_k
flat out vec3 v_normal;
flat out vec3 v_axis;    // of its ellipse
flat out vec2 v_radii;   // R along the axis and across it, within the view's bounds
flat out float v_share;  // the share of its weight that counts in the sums
flat out float v_sure;   // its squared luminance without the variance of its noise
#if GRADIENTS
flat out vec2 v_curvature;
flat out mat3 v_m;
flat out mat3 v_g;
#else
flat out vec3 v_irradiance;
#endif

const float HARDLY = 1e-20;  // so small a share that any other record decides

// Passes the record at `texel` on. ellipse, trust: from view_ellipse.
void pass_record(ivec2 texel, Ellipse ellipse, float trust)
{
    v_place = record_position(texel);
    v_normal = record_normal(texel);
    v_axis = ellipse.axis;
    v_radii = vec2(ellipse.along, ellipse.across) / a;
    v_share = record_enclosed(texel) ? HARDLY : 1.0;
    v_sure = 1.0 - record_noise(texel) * record_noise(texel);
#if GRADIENTS
    v_m = record_vectors(texel);
    // the derivatives hold within the record's own radius; where the view's least radius is greater, they are scaled down
    v_g = record_gradient(texel) * trust;
    v_curvature = usable_curvature(texel) * trust * trust;
#else
    v_irradiance = record_irradiance(texel);
#endif
}
