// A record as the cache keeps it, found by its number.
uniform sampler2D records_position;
uniform sampler2D records_normal;
uniform sampler2D records_irradiance;  // rgb E, a R_k
uniform sampler2D records_m_r;         // irradiance vectors of red, green and blue
uniform sampler2D records_m_g;
uniform sampler2D records_m_b;
uniform sampler2D records_g_r;         // translation gradients likewise
uniform sampler2D records_g_g;
uniform sampler2D records_g_b;
uniform sampler2D records_limit;       // what R_k may be at most, so that a record does not contradict others
uniform int record_columns;

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
