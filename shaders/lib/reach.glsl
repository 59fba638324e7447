// How far a record reaches in this view.
#include "lib/weight.glsl"
#include "lib/record.glsl"

uniform vec3 eye;
uniform vec2 reach;  // least and greatest a·R in metres at distance 1 (0: no greatest)

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
    return view_radius(min(record.a, texelFetch(records_limit, texel, 0).r), d);
}
