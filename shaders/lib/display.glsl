// Tone mapping: exposed linear radiance to display values (METHOD.md, 10.2).
#include "generated/constants.glsl"

// Return Hable's filmic curve (2010, "Uncharted 2: HDR Lighting"), not yet scaled to map FILMIC_WHITE to 1.
vec3 hable(vec3 v)
{
    return (v * (FILMIC_A * v + FILMIC_C * FILMIC_B) + FILMIC_D * FILMIC_E) /
               (v * (FILMIC_A * v + FILMIC_B) + FILMIC_D * FILMIC_F) - FILMIC_E / FILMIC_F;
}

// Return the sRGB-encoded display colour, 0..1, of exposed linear radiance.
vec3 display(vec3 radiance)
{
    vec3 x = FILMIC_SCALE * clamp(radiance, 0.0, FILMIC_WHITE / FILMIC_SCALE);
    vec3 c = clamp(hable(x) / hable(vec3(FILMIC_WHITE)), 0.0, 1.0);
    return mix(SRGB_SLOPE * c, (1.0 + SRGB_OFFSET) * pow(c, vec3(1.0 / SRGB_POWER)) - SRGB_OFFSET, step(SRGB_LINEAR_END, c));
}
