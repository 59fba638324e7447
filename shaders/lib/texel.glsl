// The texel in column at.x and row at.y of a texture that is neither filtered nor repeated. texelFetch gives the same; but software
// renderers take up to a third less time for it, since they do not test whether there is such a texel. The shading of a hit takes
// some 25 such lookups.
vec4 texel_at(sampler2D values, ivec2 at)
{
    return textureLod(values, (vec2(at) + 0.5) / vec2(textureSize(values, 0)), 0.0);
}

ivec4 texel_at(isampler2D values, ivec2 at)
{
    return textureLod(values, (vec2(at) + 0.5) / vec2(textureSize(values, 0)), 0.0);
}

uvec4 texel_at(usampler2D values, ivec2 at)
{
    return textureLod(values, (vec2(at) + 0.5) / vec2(textureSize(values, 0)), 0.0);
}

// Column and row of the i-th texel of a square `side` texels wide, row by row; in floats, exact below 2^20: software renderers take
// long for the division of integers.
ivec2 texel_of_square(int i, int side)
{
    int row = int((float(i) + 0.5) / float(side));
    return ivec2(i - row * side, row);
}

// The pixel of a square of side² pixels, in column square.x and row square.y of such squares, that stands for it: another one in each, so that no
// thin strip lies between all of them. In floats, as above.
ivec2 pixel_of_square(ivec2 square, int side)
{
    return side * square + ivec2(mod(vec2(square.yx), float(side)));
}
