// Holes in surfaces: light passes at points with an opacity below the material's cutoff (METHOD.md, 3.9).
#include "lib/dither.glsl"
#include "lib/material_table.glsl"

#if TEXTURES
const float DITHER = 4.0;  // cells of the dither noise along a texel of a layer, as in Wyman and McGuire (2017)
#endif

// Return true if light passes through a hole at the point.
bool light_passes(Vertex point)
{
    int material = int(point.material);
    float opacity = point.opacity, cutoff = material_row(material, MATERIAL_EMISSION).w;
#if TEXTURES
    // the finest level, because means over holes would hide or widen holes
    opacity *= texture_mean(point, MATERIAL_ALBEDO_TEXTURE, vec2(0.0)).a;
    vec4 across = material_row(material, MATERIAL_ALBEDO_TEXTURE), down = material_row(material, MATERIAL_ALBEDO_TEXTURE + 1);
    vec4 cut_out = material_row(material, MATERIAL_ALBEDO_TEXTURE + 2);
    vec2 dither_cell = texture_coordinates(point, across, down, 0.0) * float(textureSize(texture_layers, 0).x) * DITHER;
    // the alpha of a dithered layer is the opaque share of a texel; the vertex opacity is relative to that of the material
    if (across.w >= 0.0 && cut_out.y > 0.5) return opacity * cut_out.x / max(cutoff, 1e-6) <= dither(dither_cell);
#endif
    return opacity < cutoff;
}
