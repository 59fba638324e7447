// The examination (Jones 2010, 2.3; METHOD.md, 7.2): a fragment finds a tile's pixel of least effective weight.
#include "indirect/effective_weight.glsl"
#include "lib/gbuffer.glsl"

uniform sampler2D sums;      // Σ k·E, Σ k
uniform sampler2D weight;    // Σw, NOTHING_SEEN without a surface; Σ k·(Y² - σ²)
#if REFINED
uniform sampler2D reach;     // valid share of the records' reach at each pixel of the sums
#endif
uniform int pixel_stride;    // pixels of the g-buffer per pixel of the sums, in x and y
uniform int side;            // pixels of the sums along a side of a tile
uniform ivec2 first_tile;    // column and row, in the whole picture, of the first tile of this part
uniform ivec2 begin;         // first pixel of the sums in the picture
uniform ivec2 end;           // pixel after the last one
uniform int step_size;       // distance between successive pixels of the search in a tile; coprime to side²
uniform int seed;

layout(location = 0) out vec4 out_position;  // position of the pixel of least weight; w: number of requesting pixels
layout(location = 1) out vec4 out_normal;    // shading normal of this pixel; w: octahedral x of the geometric normal
layout(location = 2) out vec4 out_rest;      // octahedral y of the geometric normal, effective weight, surface pixels, triangle

// Return a random number for a tile (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering": pcg).
uint random(uvec2 tile)
{
    uint v = tile.x + tile.y * 16384u + uint(seed) * 268435399u;
    v = v * 747796405u + 2891336453u;
    v = ((v >> ((v >> 28u) + 4u)) ^ v) * 277803737u;
    return (v >> 22u) ^ v;
}

// Return the effective weight at a pixel of the sums.
float weight_at(ivec2 pixel)
{
    float share = 1.0;
#if REFINED
    share = texel_at(reach, pixel).r;
#endif
    return effective_weight(texel_at(weight, pixel).rg, texel_at(sums, pixel), share);
}

void main()
{
    ivec2 tile = ivec2(gl_FragCoord.xy), corner = tile * side, past = min(end, textureSize(weight, 0));
    // the search starts at a random pixel and takes the first of equal pixels, so that it prefers no position in the tile
    int count = side * side, i = int(random(uvec2(tile + first_tile)) % uint(count)), worst = i;
    float least = NOTHING_SEEN, requests = 0.0, surfaces = 0.0;
    for (int n = 0; n < count; ++n)
    {
        i += step_size;
        i = i >= count ? i - count : i;
        ivec2 pixel = corner + texel_of_square(i, side);
        bool inside = all(greaterThanEqual(pixel, begin)) && all(lessThan(pixel, past));
        float w = inside ? weight_at(pixel) : NOTHING_SEEN;
        surfaces += w < NOTHING_SEEN ? 1.0 : 0.0;
        requests += w < tolerance ? 1.0 : 0.0;
        worst = w < least ? i : worst;
        least = min(w, least);
    }
    ivec2 pixel = min(corner + texel_of_square(worst, side), past - 1) * pixel_stride;
    out_position = vec4(texel_at(position, pixel).xyz, requests);
    out_normal = texel_at(normal, pixel);
    out_rest = vec4(texel_at(albedo, pixel).w, least, surfaces, texel_at(emission, pixel).w);
}
