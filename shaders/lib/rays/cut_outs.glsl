// Holes in surfaces: light passes where the opacity is less than the material's cutoff.
#include "lib/dither.glsl"
#include "lib/material_table.glsl"

#if TEXTURES
const float DITHER = 4.0;  // steps of the noise in a texel of a layer
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
    // a dithered layer holds the opaque share; the vertices' opacity is relative to the material's own
    if (across.w >= 0.0 && about.y > 0.5) return opacity * about.x / max(cutoff, 1e-6) <= dither(place);
#endif
    return opacity < cutoff;
}
