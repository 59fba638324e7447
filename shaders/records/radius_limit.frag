// Limit of a record's reach by inter-record variance, as a share of its radii; a fragment is a record.
// The record's extrapolation to another's place is compared with the irradiance gathered there. The relative difference is
// assumed to grow with the square of the distance. The limit is the distance at which it reaches `adapt` (after Křivánek et al.
// 2006, "Making Radiance and Irradiance Caching Practical: Adaptive Caching and Neighbor Clamping").
#include "records/weight.glsl"
#include "records/record.glsl"
#include "records/point_grid.glsl"

uniform float adapt;        // relative difference that is allowed at the rim of a record's ellipse
uniform sampler2D targets;  // numbers of the records to limit, one a texel, row by row
uniform int count;          // of those records
uniform bool by_all;        // each is compared with those of higher numbers too, not only with those that came before it

layout(location = 0) out float out_limit;

// IN_FRONT is from settings.py. COMPARED_WITHIN, from radius_limit_pass.py, is the greatest distance of compared records, in
// radii a·R: more than 1, since a place between two records may be covered by only one of them.
// Records whose normals differ by more than the angle of this cosine are not compared.
const float COMPARABLE_COSINE = 0.7;
const float SURE = 2.0;  // standard errors of a difference, which may be noise: the least limit is by the greatest of many differences

void main()
{
    ivec2 here = ivec2(gl_FragCoord.xy);
    bool requested = here.y * textureSize(targets, 0).x + here.x < count;
    int number = int(texelFetch(targets, here, 0).r);
    ivec2 texel = table_texel(number);
    vec3 p = record_position(texel), n = record_normal(texel);
    float Y = dot(record_irradiance(texel), LUMINANCE);
    vec3 M = n * Y, gradient = vec3(0.0);
    Ellipse ellipse = record_ellipse(texel);
    vec2 R = vec2(ellipse.along, ellipse.across), curvature = vec2(0.0);
#if GRADIENTS
    M = record_vectors(texel) * LUMINANCE;
    gradient = record_gradient(texel) * LUMINANCE;
    curvature = usable_curvature(texel);
#endif
    float limit = 1.0, range = requested ? COMPARED_WITHIN * a * max(R.x, R.y) * 1.0001 : -1e30;
    Walk walk = grid_walk(p - range, p + range);
    vec4 other;
    bool found;
    while (grid_step(walk, found, other))
    {
        vec3 apart = other.xyz - p;
        float at = record_distance(apart, ellipse.axis, R);
        if (!found || !by_all && int(other.w) > number) continue;
        if (at >= COMPARED_WITHIN * a || at <= 0.0) continue;
        ivec2 theirs = table_texel(int(other.w));
        if (record_enclosed(theirs)) continue;
        vec3 n_j = record_normal(theirs);
        if (dot(n, n_j) < COMPARABLE_COSINE || abs(dot(apart, n + n_j)) * 0.5 > IN_FRONT * R.y) continue;
        float Y_j = dot(record_irradiance(theirs), LUMINANCE);
        float Y_turned = dot(M, n_j) + LUNES * (1.0 - dot(n, n_j)) * dot(M, n);  // as turned() has it
        float Y_here = extrapolated(vec3(Y_turned), vec3(dot(gradient, apart)), apart, n, ellipse.axis, curvature).x;
        float off = Y_here - Y_j, noise = SURE * length(vec2(record_noise(texel) * Y, record_noise(theirs) * Y_j));
        float difference = sqrt(max(off * off - noise * noise, 0.0)) / error_scale(max(Y, Y_j));
        limit = difference * at * at > 0.0 ? min(limit, at / a * sqrt(adapt / difference)) : limit;
    }
    out_limit = limit;
}
