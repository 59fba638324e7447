// The light of a pixel's surface through the filters in front of it. Both textures have a texel for each pixel, or one for all of them.
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

// The opacity of the filters, 0..1: the greatest of the three channels.
float held_back(ivec2 pixel)
{
    return 1.0 - least(filter_texel(tint, pixel));
}

// The light through the filters at a pixel without a surface, at `at` in pixels. A backdrop that emits no light lies behind the
// picture by the alpha: the least share of the three channels. The remainder of each channel comes from the sky.
vec3 filtered_backdrop(ivec2 pixel, vec2 at)
{
    vec3 share = filter_texel(tint, pixel);
    if (sky_is_seen == 0) share -= least(share);
    return share * sky_behind(at) + filter_texel(glow, pixel);
}
