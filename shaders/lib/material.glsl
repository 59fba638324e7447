// Reflection and emission of a Lambertian surface: radiance in W/(m² sr) from an irradiance E in W/m².
#include "generated/constants.glsl"
#include "generated/material.glsl"

vec3 reflected_radiance(Material material, vec3 E)
{
    return material.albedo * INV_PI * E;
}

vec3 outgoing_radiance(Material material, vec3 E)
{
    return material.emission + reflected_radiance(material, E);
}
