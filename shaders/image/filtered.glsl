// What the filters before a pixel's surface make of its light. Both textures have a texel for each pixel, or one for all of them.
#include "image/backdrop.glsl"
#include "lib/texel.glsl"

uniform sampler2D tint;  // the share of light that comes through
uniform sampler2D glow;  // the radiance that they add

vec3 filter_texel(sampler2D values, ivec2 pixel)
{
    return texel_at(values, min(pixel, textureSize(values, 0) - 1)).rgb;
}

vec3 filtered(ivec2 pixel, vec3 radiance)
{
    return radiance * filter_texel(tint, pixel) + filter_texel(glow, pixel);
}

float least(vec3 share)
{
    return min(min(share.r, share.g), share.b);
}

// How far they cover what is behind them, 0..1: of the channel of which they hold back most.
float held_back(ivec2 pixel)
{
    return 1.0 - least(filter_texel(tint, pixel));
}

// The same of a pixel that sees no surface, at `at` in pixels. Of a backdrop that is no light, what all channels let through is put
// behind the picture by its alpha; what some let through beyond that is taken from the sky, and is the filters' own colour.
vec3 filtered_backdrop(ivec2 pixel, vec2 at)
{
    vec3 share = filter_texel(tint, pixel);
    if (sky_is_seen == 0) share -= least(share);
    return share * sky_behind(at) + filter_texel(glow, pixel);
}
