// The limit of a record's radii by inter-record differences, as a share of the radii (METHOD.md, 5.5). A fragment is a record.
// The record extrapolates to its neighbours, and is compared with their irradiance. The relative difference is assumed to grow
// with the square of the distance. The limit is the distance at which the difference reaches `adapt` (after Křivánek et al. 2006,
// "Making Radiance and Irradiance Caching Practical: Adaptive Caching and Neighbor Clamping").
#include "records/weight.glsl"
#include "records/record.glsl"

uniform float adapt;        // allowed relative difference at the rim of a record's ellipse
uniform sampler2D targets;  // numbers of the records to limit, one per texel, row by row
uniform int count;          // number of records to limit
uniform bool by_all;        // true if all records are compared; false: only with records of lower numbers, which are older
uniform sampler2D others;   // compared records, strip by strip: xyz position, w number
uniform ivec2 axes;         // 0, 1 or 2 for x, y or z: the axis along which a strip is sorted, and the axis across the strips
uniform vec2 bounds;        // least and greatest coordinate across the strips of the records in the strip of this draw
uniform ivec2 span;         // records of this strip: the first one, and the one after the last

layout(location = 0) out float out_limit;

// COMPARED_WITHIN, from adaptive_radius.py, is the greatest distance of compared records, in radii a·R. It is more than 1,
// because only one of two records may cover a point between them.
const float COMPARABLE_COSINE = 0.7;  // least cosine between the normals of compared records
const float NOISE_ERRORS = 2.0;  // standard errors of noise that do not count: the greatest of many differences would be noise

vec4 neighbour_at(int i)
{
    return texelFetch(others, table_texel(i), 0);
}

// Return the first record of the strip whose coordinate along the strip is at least `least`, by bisection.
int first_from(float least)
{
    int low = span.x, high = span.y;
    while (low < high)
    {
        int middle = (low + high) / 2;
        bool below = neighbour_at(middle)[axes.x] < least;
        low = below ? middle + 1 : low;
        high = below ? high : middle;
    }
    return low;
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    bool requested = pixel.y * textureSize(targets, 0).x + pixel.x < count;
    int number = int(texelFetch(targets, pixel, 0).r);
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
    range = p[axes.y] + range < bounds.x || p[axes.y] - range > bounds.y ? -1e30 : range;
    for (int i = first_from(p[axes.x] - range); i < span.y; ++i)
    {
        vec4 neighbour = neighbour_at(i);
        if (neighbour[axes.x] > p[axes.x] + range) break;
        vec3 offset = neighbour.xyz - p;
        float distance = record_distance(offset, ellipse.axis, R);
        if (!by_all && int(neighbour.w) > number) continue;
        if (distance >= COMPARED_WITHIN * a || distance <= 0.0) continue;
        ivec2 texel_j = table_texel(int(neighbour.w));
        if (record_enclosed(texel_j)) continue;
        vec3 n_j = record_normal(texel_j);
        if (dot(n, n_j) < COMPARABLE_COSINE || abs(dot(offset, n + n_j)) * 0.5 > IN_FRONT * R.y) continue;
        float Y_j = dot(record_irradiance(texel_j), LUMINANCE);
        float Y_rotated = dot(M, n_j) + LUNES * (1.0 - dot(n, n_j)) * dot(M, n);  // as rotated_irradiance()
        float Y_extrapolated = extrapolated_irradiance(vec3(Y_rotated), vec3(dot(gradient, offset)), offset, n, ellipse.axis, curvature).x;
        float error = Y_extrapolated - Y_j, noise = NOISE_ERRORS * length(vec2(record_noise(texel) * Y, record_noise(texel_j) * Y_j));
        float difference = sqrt(max(error * error - noise * noise, 0.0)) / error_scale(max(Y, Y_j));
        limit = difference * distance * distance > 0.0 ? min(limit, distance / a * sqrt(adapt / difference)) : limit;
    }
    out_limit = limit;
}
