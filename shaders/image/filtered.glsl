// Radiance behind filters, which image/tint.frag draws. Both textures have one texel per pixel, or one for all pixels.
#include "image/backdrop.glsl"
#include "lib/texel.glsl"

uniform sampler2D tint;  // transmittance of the filters
uniform sampler2D glow;  // radiance that the filters add, W/(m² sr)

// Return the value of a filter texture at a pixel.
vec3 filter_texel(sampler2D values, ivec2 pixel)
{
    return texel_at(values, min(pixel, textureSize(values, 0) - 1)).rgb;
}

// Return `radiance` after the filters of a pixel.
vec3 filtered(ivec2 pixel, vec3 radiance)
{
    return radiance * filter_texel(tint, pixel) + filter_texel(glow, pixel);
}

float least(vec3 transmittance)
{
    return min(min(transmittance.r, transmittance.g), transmittance.b);
}

// Return the opacity of the filters, 0..1: the greatest of the three channels.
float filter_opacity(ivec2 pixel)
{
    return 1.0 - least(filter_texel(tint, pixel));
}

// Return the radiance of the background at `at` after the filters. A backdrop without light shows through by the least
// transmittance of the three channels, as alpha. The remaining transmittance of each channel shows the sky.
vec3 filtered_backdrop(ivec2 pixel, vec2 at)
{
    vec3 transmittance = filter_texel(tint, pixel);
    if (sky_is_seen == 0) transmittance -= least(transmittance);
    return transmittance * sky_behind(at) + filter_texel(glow, pixel);
}
