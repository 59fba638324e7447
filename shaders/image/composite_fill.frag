// Holes, while a view fills: pixels that no record reaches yet take the light of those around, so that nothing starts out black.
uniform sampler2D position;  // g-buffer
uniform sampler2D sums;      // Σ k·E, Σ k, with mipmaps
uniform int levels;          // of the mipmap

layout(location = 0) out vec4 out_sums;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_sums = texelFetch(sums, pixel, 0);
    if (texelFetch(position, pixel, 0).w == 0.0) return;
    vec2 uv = gl_FragCoord.xy / vec2(textureSize(sums, 0));
    // every other mipmap level, weighted 2^(-4·level): the finest that has anything decides, and transitions are smooth, since each
    // level's sums fade out where it has nothing
    int last = out_sums.a > 0.0 ? 0 : levels;
    for (int level = 1; level < last; level += 2) out_sums += textureLod(sums, uv, float(level)) * exp2(-4.0 * float(level));
}
