// What is cut out of surfaces for light: it passes where the opacity is less than the material's cutoff.
#include "lib/material_table.glsl"

#if TEXTURES
const float DITHER = 4.0;  // steps of the noise in a texel of a layer

// Interleaved gradient noise, 0..1 (Jimenez 2014): low values are spread evenly.
float dither(vec2 place)
{
    return fract(52.9829189 * fract(dot(mod(floor(place), 512.0), vec2(0.06711056, 0.00583715))));
}
#endif

bool light_passes(Vertex point)
{
    int material = int(point.material);
    float opacity = point.opacity, cutoff = material_row(material, MATERIAL_EMISSION).w;
#if TEXTURES
    // the finest level: means over holes would hide or widen them
    opacity *= texture_mean(point, MATERIAL_ALBEDO_TEXTURE, vec2(0.0)).a;
    vec4 across = material_row(material, MATERIAL_ALBEDO_TEXTURE), down = material_row(material, MATERIAL_ALBEDO_TEXTURE + 1);
    vec4 about = material_row(material, MATERIAL_ALBEDO_TEXTURE + 2);
    vec2 place = texture_place(point, across, down, 0.0) * float(textureSize(texture_layers, 0).x) * DITHER;
    // a dithered layer has the share that is there; what the vertices' opacity changes is relative to the material's own
    if (across.w >= 0.0 && about.y > 0.5) return opacity * about.x / max(cutoff, 1e-6) <= dither(place);
#endif
    return opacity < cutoff;
}
