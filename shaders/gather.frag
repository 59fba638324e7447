// Radiance that leaves the surface towards the record: emission and shadow-mapped direct light; and how far it is.
#define FOOTPRINT
#include "lib/lights.glsl"
#include "lib/surface.glsl"

in vec3 v_position;
in vec3 v_normal;
in vec3 v_albedo;
in vec3 v_emission;
flat in vec3 v_eye;

const float FARTHEST = 4.0;  // times the centre's depth, where a corner looks past the plane's horizon

layout(location = 0) out vec4 out_radiance;  // rgb W/(m² sr), a distance in metres (0: nothing hit, the sky)

// What the texel sees of the plane through v_position with normal g. The direction q (to depth 1) is affine on screen.
void see_footprint(vec3 g)
{
    vec3 q = (v_position - v_eye) * gl_FragCoord.w, x = 0.5 * dFdx(q), y = 0.5 * dFdy(q);
    float k = dot(g, v_position - v_eye), depth = 1.0 / gl_FragCoord.w;
    vec3 corners[4] = vec3[](q - x - y, q + x - y, q + x + y, q - x + y);
    for (int i = 0; i < 4; ++i)
    {
        float t = k / min(dot(g, corners[i]), -1e-20);  // g faces the record: both are negative before the horizon
        footprint[i] = corners[i] * min(t, FARTHEST * depth) - (v_position - v_eye);
    }
    footprint_area = 0.5 * length(cross(footprint[2] - footprint[0], footprint[3] - footprint[1])) + 1e-30;
}

void main()
{
    vec3 to_eye = v_eye - v_position;
    float r = length(to_eye);
    vec3 g = geometric_normal(v_position, v_eye, gl_PrimitiveID);
    Receiver receiver = Receiver(v_position, shading_normal(v_normal, g), g);
    see_footprint(g);
    vec3 E = direct_irradiance(receiver, 1, vec2(1.0, 0.0));
    out_radiance = vec4(v_emission + v_albedo * INV_PI * E, max(r, 1e-30));
}
