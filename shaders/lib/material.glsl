// The material at a point of a Lambertian surface, and its outgoing radiance in W/(m² sr) from the irradiance E in W/m².
#include "generated/constants.glsl"

struct Material
{
    vec3 albedo;    // diffuse reflectance, linear
    vec3 emission;  // emitted radiance, W/(m² sr)
};

// Return the reflected radiance, ρ/π·E.
vec3 reflected_radiance(Material material, vec3 E)
{
    return material.albedo * INV_PI * E;
}

// Return the sum of emitted and reflected radiance, L_e + ρ/π·E.
vec3 outgoing_radiance(Material material, vec3 E)
{
    return material.emission + reflected_radiance(material, E);
}
