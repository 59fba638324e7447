// A record as the cache keeps it, found by its number.
#include "lib/constants.glsl"

uniform sampler2D records_position;
uniform sampler2D records_normal;
uniform sampler2D records_irradiance;  // rgb E, a R_k
uniform sampler2D records_m_r;         // irradiance vectors of red, green and blue; w: x, y and z of the bend's axis
uniform sampler2D records_m_g;
uniform sampler2D records_m_b;
uniform sampler2D records_g_r;         // translation gradients likewise; w: the bend along its axis, across it, and the greatest radius
uniform sampler2D records_g_g;
uniform sampler2D records_g_b;
uniform sampler2D records_walls;       // the two nearest walls that stand on its surface, each by its coordinates along the bend's
                                       // axis and across it: beyond one is where dot(p - p_k, wall) > 1
uniform sampler2D records_limit;       // share of its radii at most, so that a record does not contradict others
uniform int record_columns;
uniform float dark;                    // W/m²: what is darker than this may be off by as much of this as light is of itself
uniform bool hessian;                  // radii by second derivatives, else by the harmonic mean distance
uniform bool second_order;             // records know how their gradients change
uniform bool walls;                    // they say nothing beyond the walls that stand on their surface

// Second derivatives of a record's light in its tangent plane, as shares of the light itself: luminance decides.
struct Bend
{
    vec3 axis;     // unit, along which it bends least; 0 where it is not known
    float along;   // 1/m²
    float across;
};

// Where a record's error comes to the same size: an ellipse in its tangent plane.
struct Ellipse
{
    vec3 axis;     // unit, along which it reaches farthest
    float along;   // metres
    float across;
};

ivec2 record_texel(int i)
{
    return ivec2(i % record_columns, i / record_columns);
}

mat3 record_vectors(ivec2 texel)
{
    return mat3(texelFetch(records_m_r, texel, 0).xyz, texelFetch(records_m_g, texel, 0).xyz, texelFetch(records_m_b, texel, 0).xyz);
}

mat3 record_gradient(ivec2 texel)
{
    return mat3(texelFetch(records_g_r, texel, 0).xyz, texelFetch(records_g_g, texel, 0).xyz, texelFetch(records_g_b, texel, 0).xyz);
}

Bend record_bend(ivec2 texel)
{
    vec3 axis = vec3(texelFetch(records_m_r, texel, 0).w, texelFetch(records_m_g, texel, 0).w, texelFetch(records_m_b, texel, 0).w);
    return Bend(axis, texelFetch(records_g_r, texel, 0).w, texelFetch(records_g_g, texel, 0).w);
}

// What the record at `texel` says by its bends, along the axis and across it, and its walls; 0 where the settings want none.
vec2 record_bends(ivec2 texel)
{
    Bend bend = record_bend(texel);
    return second_order && bend.axis != vec3(0.0) ? vec2(bend.along, bend.across) : vec2(0.0);
}

vec4 record_walls(ivec2 texel)
{
    return walls ? texelFetch(records_walls, texel, 0) : vec4(0.0);
}

// How far the record at `texel` speaks for others as far as itself can tell, in R: a·R is where what it leaves out, ½·|bend|·d²,
// comes to a² of its light (after Schwarzhaupt, Jensen and Jarosz 2012); or R_k, where light changes fast E/|∇E| (Krivanek 2006).
Ellipse record_ellipse(ivec2 texel)
{
    vec4 record = texelFetch(records_irradiance, texel, 0);
    vec3 n = texelFetch(records_normal, texel, 0).xyz;
    vec3 aside = normalize(abs(n.y) < 0.9 ? vec3(n.z, 0.0, -n.x) : vec3(0.0, -n.z, n.y));
    float R = record.a;
#if GRADIENTS
    Bend bend = record_bend(texel);
    float slope = length(record_gradient(texel) * LUMINANCE), Y = dot(record.rgb, LUMINANCE), E = max(Y, max(dark, 1e-20));
    if (bend.axis != vec3(0.0))
    {
        float square = 2.0 * E / max(Y, 1e-20);
        vec2 radii = sqrt(square / max(abs(vec2(bend.along, bend.across)), 1e-14));
        radii = min(radii, texelFetch(records_g_b, texel, 0).w);
        if (hessian) return Ellipse(bend.axis, radii.x, radii.y);
        aside = bend.axis;  // which the bends and walls belong to, in a circle too
    }
    R = slope * R > E ? E / slope : R;
#endif
    return Ellipse(aside, R, R);
}
