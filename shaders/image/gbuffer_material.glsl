// The material of the surface at a pixel.
#include "lib/material.glsl"
#include "lib/texel.glsl"

uniform sampler2D albedo;    // g-buffer
uniform sampler2D emission;  // g-buffer, W/(m² sr)

// Return the material at a pixel of the g-buffer.
Material material_at(ivec2 pixel)
{
    return Material(texel_at(albedo, pixel).rgb, texel_at(emission, pixel).rgb);
}
