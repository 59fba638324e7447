// Outgoing radiance of a Lambertian surface in W/(m² sr), from the irradiance E in W/m².
#include "generated/constants.glsl"
#include "generated/material.glsl"

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
