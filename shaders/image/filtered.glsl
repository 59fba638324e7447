// What the filters before a pixel's surface make of its light. Both textures have a texel for each pixel, or one for all of them.
uniform sampler2D tint;  // the share of light that comes through
uniform sampler2D glow;  // the radiance that they add

vec3 filter_texel(sampler2D values, ivec2 pixel)
{
    return texelFetch(values, min(pixel, textureSize(values, 0) - 1), 0).rgb;
}

vec3 filtered(ivec2 pixel, vec3 radiance)
{
    return radiance * filter_texel(tint, pixel) + filter_texel(glow, pixel);
}

// How far they cover what is behind them, on the mean of the channels, 0..1.
float held_back(ivec2 pixel)
{
    vec3 share = filter_texel(tint, pixel);
    return 1.0 - (share.r + share.g + share.b) / 3.0;
}
