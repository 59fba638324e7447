// How far a record may reach without contradicting others: the share of its radii. A fragment is a record.
#include "records/weight.glsl"
#include "records/record.glsl"
#include "records/grid.glsl"

uniform float adapt;        // relative difference that is allowed where a record's reach ends
uniform sampler2D targets;  // numbers of the records that are limited, one a texel, row by row
uniform int count;          // of them

layout(location = 0) out float out_limit;

// IN_FRONT is settings.py's, FAR passes/adapt.py's: how far, in reaches, others are held against a record; what lies beyond the
// rim tells of it as well, since between the two there may be a place that only one serves
// records whose normals differ more than this are no witnesses of each other
const float ALIKE = 0.7;

void main()
{
    ivec2 here = ivec2(gl_FragCoord.xy);
    bool wanted = here.y * textureSize(targets, 0).x + here.x < count;
    ivec2 texel = record_texel(int(texelFetch(targets, here, 0).r));
    vec3 p = texelFetch(records_position, texel, 0).xyz, n = texelFetch(records_normal, texel, 0).xyz;
    vec4 record = texelFetch(records_irradiance, texel, 0);
    float Y = dot(record.rgb, LUMINANCE);
    vec3 M = n * Y, gradient = vec3(0.0);
    Ellipse ellipse = record_ellipse(texel);
    vec2 R = vec2(ellipse.along, ellipse.across), bends = vec2(0.0);
    vec4 beyond = vec4(0.0);
#if GRADIENTS
    M = record_vectors(texel) * LUMINANCE;
    gradient = record_gradient(texel) * LUMINANCE;
    bends = record_bends(texel);
    beyond = record_walls(texel);
#endif
    float limit = 1.0, far = wanted ? FAR * a * max(R.x, R.y) * 1.0001 : -1e30;
    Walk walk = grid_walk(p - far, p + far);
    vec4 other;
    bool found;
    while (grid_step(walk, found, other))
    {
        vec3 apart = other.xyz - p;
        float at = record_distance(apart, ellipse.axis, R);
        if (!found || at >= FAR * a || at <= 0.0 || record_beyond(apart, ellipse.axis, n, beyond)) continue;
        ivec2 theirs = record_texel(int(other.w));
        vec3 n_j = texelFetch(records_normal, theirs, 0).xyz;
        if (dot(n, n_j) < ALIKE || abs(dot(apart, n + n_j)) * 0.5 > IN_FRONT * R.y) continue;
        vec4 E_j = texelFetch(records_irradiance, theirs, 0);
#if NEIGHBOURS
        // radii that differ by more than the distance: what is near to the one is as near to the other (Krivanek et al. 2006)
        limit = min(limit, (E_j.a + length(apart)) / record.a);
#endif
        // what it says of the other's place, against what the other found there; the error grows with the square of the distance
        float Y_j = dot(E_j.rgb, LUMINANCE);
        float said = record_says(vec3(dot(M, n_j)), vec3(dot(gradient, apart)), apart, n, ellipse.axis, bends).x;
        float off = abs(said - Y_j) / max(max(Y, Y_j), max(dark, 1e-20));
        limit = off * at * at > 0.0 ? min(limit, at / a * sqrt(adapt / off)) : limit;
    }
    out_limit = limit;
}
