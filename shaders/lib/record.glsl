// A record as the cache keeps it, found by its number, and how far it reaches in this view.
#include "lib/weight.glsl"

uniform sampler2D records_position;
uniform sampler2D records_normal;
uniform sampler2D records_irradiance;  // rgb E, a R_k
uniform sampler2D records_m_r;         // irradiance vectors of red, green and blue
uniform sampler2D records_m_g;
uniform sampler2D records_m_b;
uniform sampler2D records_g_r;         // translation gradients likewise
uniform sampler2D records_g_g;
uniform sampler2D records_g_b;
uniform int record_columns;
uniform vec3 eye;
uniform vec2 reach;                    // least and greatest a·R in metres at distance 1 (0: no greatest)

ivec2 record_texel(int i)
{
    return ivec2(i % record_columns, i / record_columns);
}

mat3 record_gradient(ivec2 texel)
{
    return mat3(texelFetch(records_g_r, texel, 0).xyz, texelFetch(records_g_g, texel, 0).xyz, texelFetch(records_g_b, texel, 0).xyz);
}

// R_k where light changes fast, in metres: R <= E/|∇E| on luminance (Krivanek et al. 2006).
float gradient_limit(float R, vec3 irradiance, mat3 gradient)
{
    const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);
    float slope = length(gradient * LUMINANCE), E = dot(irradiance, LUMINANCE);
    return slope * R > E ? E / slope : R;
}

// The radius a·R in metres within what the view allows, `d` metres from the eye.
float view_radius(float R, float d)
{
    float r = max(a * R, reach.x * d);
    return reach.y > 0.0 ? min(r, reach.y * d) : r;
}

// The same for the record at `texel`, all limits together.
float record_radius(ivec2 texel, float d)
{
    vec4 record = texelFetch(records_irradiance, texel, 0);
#if GRADIENTS
    record.a = gradient_limit(record.a, record.rgb, record_gradient(texel));
#endif
    return view_radius(record.a, d);
}
