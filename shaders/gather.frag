// Radiance that leaves the surface towards the record: emission and shadow-mapped direct light; and how far it is.
#include "lib/lights.glsl"
#include "lib/surface.glsl"

in vec3 v_position;
in vec3 v_normal;
in vec3 v_albedo;
in vec3 v_emission;
flat in vec3 v_eye;

layout(location = 0) out vec4 out_radiance;  // rgb W/(m² sr), a distance in metres (0: nothing hit, the sky)

void main()
{
    vec3 to_eye = v_eye - v_position;
    float r = length(to_eye);
    vec3 g = geometric_normal(v_position, v_eye, to_eye / max(r, 1e-30));
    Receiver receiver = Receiver(v_position, shading_normal(v_normal, g), g);
    vec3 E = direct_irradiance(receiver, 1, vec2(1.0, 0.0));
    out_radiance = vec4(v_emission + v_albedo * INV_PI * E, max(r, 1e-30));
}
