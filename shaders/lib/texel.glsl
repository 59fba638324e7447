// The texel in column at.x and row at.y of a texture that is neither filtered nor repeated. It is what texelFetch gives; but software
// renderers take a third less time for it, since they need not look whether there is such a texel.
vec4 texel_at(sampler2D values, ivec2 at)
{
    return textureLod(values, (vec2(at) + 0.5) / vec2(textureSize(values, 0)), 0.0);
}
