// How far a record may reach without contradicting others: the limit of its R_k. A fragment is a record.
#include "lib/record.glsl"

uniform float a;
uniform float adapt;   // relative difference that is allowed where a record's reach ends
uniform ivec2 targets; // numbers of the first record that is limited, and of the one after the last
uniform ivec2 others;  // of those that it is held against

layout(location = 0) out float out_limit;

// IN_FRONT is settings.py's; records whose normals differ more than this are no witnesses of each other
const float ALIKE = 0.7;
const float NOTHING = 1e30;

void main()
{
    const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);
    int i = int(gl_FragCoord.y) * record_columns + int(gl_FragCoord.x);
    bool wanted = i >= targets.x && i < targets.y;
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 p = texelFetch(records_position, texel, 0).xyz, n = texelFetch(records_normal, texel, 0).xyz;
    vec4 record = texelFetch(records_irradiance, texel, 0);
    float Y = dot(record.rgb, LUMINANCE), R = record.a;
    vec3 M = n * Y, gradient = vec3(0.0);
#if GRADIENTS
    mat3 m = mat3(texelFetch(records_m_r, texel, 0).xyz, texelFetch(records_m_g, texel, 0).xyz, texelFetch(records_m_b, texel, 0).xyz);
    mat3 g = record_gradient(texel);
    M = m * LUMINANCE;
    gradient = g * LUMINANCE;
    R = gradient_limit(R, record.rgb, g);
#endif
    float limit = NOTHING;
    for (int j = others.x; j < (wanted ? others.y : 0); ++j)
    {
        ivec2 other = record_texel(j);
        vec3 apart = texelFetch(records_position, other, 0).xyz - p;
        float d = length(apart);
        if (d >= a * R || d <= 0.0) continue;
        vec3 n_j = texelFetch(records_normal, other, 0).xyz;
        if (dot(n, n_j) < ALIKE || abs(dot(apart, n + n_j)) * 0.5 > IN_FRONT * R) continue;
        // what it says of the other's place, against what the other found there; the error grows with the square of the distance
        float Y_j = dot(texelFetch(records_irradiance, other, 0).rgb, LUMINANCE);
        float said = max(dot(M, n_j) + dot(gradient, apart), 0.0);
        float off = abs(said - Y_j) / max(max(Y, Y_j), 1e-20);
        limit = min(limit, off > 0.0 ? d / a * sqrt(adapt / off) : NOTHING);
    }
    if (!wanted) discard;
    out_limit = limit;
}
