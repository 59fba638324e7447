// Reads of single texels, in column at.x and row at.y. The result equals that of texelFetch. Software renderers take up to a
// third less time, because they test no bounds; shading a hit takes some 25 reads.
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

// Return column and row of the i-th texel, row by row, of a square `side` texels wide. Floats, exact below 2^20, because integer
// division is slow on software renderers.
ivec2 texel_of_square(int i, int side)
{
    int row = int((float(i) + 0.5) / float(side));
    return ivec2(i - row * side, row);
}

// Return the sampled pixel of a square of side² pixels; square: column and row of the square in a grid of squares. The position
// differs between neighbouring squares, so that the samples do not miss thin strips. Floats, as above.
ivec2 pixel_of_square(ivec2 square, int side)
{
    return side * square + ivec2(mod(vec2(square.yx), float(side)));
}
