// A record as a quad that bounds its sphere of influence on screen (Jones 2010, figure 1); an instance is a record.
#include "lib/reach.glsl"

uniform int first;                     // number of the first record to splat
uniform mat4 clip_from_world;
uniform bool in_front;                 // reject records in front of the pixel's surface, or behind it
uniform float pixel;                   // size of a pixel at distance 1, in metres

flat out vec4 v_record;                // p_k, R_k as clamped for this view
flat out vec3 v_normal;
#if GRADIENTS
flat out mat3 v_m;
flat out mat3 v_g;
#else
flat out vec3 v_irradiance;
#endif

void main()
{
    ivec2 texel = record_texel(first + gl_InstanceID);
    vec3 p = texelFetch(records_position, texel, 0).xyz;
    vec4 record = texelFetch(records_irradiance, texel, 0);

    vec3 to_eye = eye - p;
    float d = length(to_eye);
    float R = record.a;
#if GRADIENTS
    v_m = mat3(texelFetch(records_m_r, texel, 0).xyz, texelFetch(records_m_g, texel, 0).xyz, texelFetch(records_m_b, texel, 0).xyz);
    v_g = record_gradient(texel);
    R = gradient_limit(R, record.rgb, v_g);
#endif
    R = min(R, texelFetch(records_limit, texel, 0).r);
    float r = view_radius(R, d);
    v_record = vec4(p, r / a);
    v_normal = texelFetch(records_normal, texel, 0).xyz;
#if GRADIENTS
    v_g *= min(1.0, a * R / r);  // a gradient holds for R alone, not for what the least radius added
#else
    v_irradiance = record.rgb;
#endif

    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    r *= 1.0 + 1e-5;  // rounding must not cut the rim
    if (d <= r)
    {
        gl_Position = vec4(corner, 0.0, 1.0);  // the eye is inside: the whole screen
        return;
    }
    // in the plane through the centre that faces the eye, a half size of r·d/√(d² - r²) bounds the silhouette
    vec3 axis = to_eye / d;
    vec3 u = normalize(abs(axis.y) < 0.9 ? cross(vec3(0.0, 1.0, 0.0), axis) : cross(vec3(1.0, 0.0, 0.0), axis));
    vec2 half_size = vec2(r * d / sqrt(d * d - r * r));
    if (in_front)
    {
        // Then only a slab of the sphere can be served. With x = |p - p_k|/R, y = √(1 - n·n_k) and x + y < a, |(p - p_k)·n_k|
        // is at most (IN_FRONT + x·y/√2)·R, x·y at most a²/4: the quad turns along the slab and shrinks to it.
        float thickness = r * (IN_FRONT / a + 0.177 * a), cosine = abs(dot(v_normal, axis)), sine = sqrt(max(0.0, 1.0 - cosine * cosine));
        float nearer = r * sine + thickness * cosine;
        if (sine > 1e-3) u = normalize(cross(axis, v_normal));
        if (nearer < d) half_size.y = min(half_size.y, (r * cosine + thickness * sine) * d / (d - nearer));
    }
    vec3 v = cross(axis, u);
    half_size = max(half_size, pixel * d);  // a quad between pixel centres would be lost
    gl_Position = clip_from_world * vec4(p + half_size.x * corner.x * u + half_size.y * corner.y * v, 1.0);
}
