// Exposed linear radiance to what a screen takes; the FILMIC_ constants come from buffers.py.

// Hable's curve (GDC 2010, "Uncharted 2: HDR Lighting"), white at FILMIC_WHITE.
vec3 hable(vec3 v)
{
    return (v * (FILMIC_A * v + FILMIC_C * FILMIC_B) + FILMIC_D * FILMIC_E) /
               (v * (FILMIC_A * v + FILMIC_B) + FILMIC_D * FILMIC_F) - FILMIC_E / FILMIC_F;
}

vec3 display(vec3 radiance)
{
    vec3 x = FILMIC_SCALE * clamp(radiance, 0.0, FILMIC_WHITE / FILMIC_SCALE);
    vec3 c = clamp(hable(x) / hable(vec3(FILMIC_WHITE)), 0.0, 1.0);
    return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));  // sRGB, IEC 61966-2-1
}
