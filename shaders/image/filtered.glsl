// What the filters before a pixel's surface leave of its light.
uniform sampler2D tint;  // of every pixel, or a single texel for all of them

vec3 tint_at(ivec2 pixel)
{
    return texelFetch(tint, min(pixel, textureSize(tint, 0) - 1), 0).rgb;
}

vec3 filtered(ivec2 pixel, vec3 radiance)
{
    return radiance * tint_at(pixel);
}

// How far they cover what is behind them, on the mean of the channels, 0..1.
float held_back(ivec2 pixel)
{
    vec3 share = tint_at(pixel);
    return 1.0 - (share.r + share.g + share.b) / 3.0;
}
