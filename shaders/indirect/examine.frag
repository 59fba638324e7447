// Where records are missing: the pixel of least effective weight in each tile of the screen (Jones 2010, section 2.3).
#include "indirect/effective_weight.glsl"
#include "lib/gbuffer.glsl"

uniform sampler2D sums;      // Σ k·E, Σ k
uniform sampler2D weight;    // Σ of raw w, NOTHING_SEEN without a surface; Σ k·(Y² - σ²)
#if REFINED
uniform sampler2D reach;     // the share of the records' reach that holds at each pixel of the sums
#endif
uniform int pixel_stride;    // pixels of the g-buffer per pixel of the sums, in x and y
uniform int side;            // pixels of the sums along a side of a tile
uniform ivec2 first_tile;    // the tile of the whole picture that is the first one here
uniform ivec2 begin;         // the first pixel of the sums that lies in the picture, and the one after the last
uniform ivec2 end;
uniform int step_size;       // from one pixel of a tile to the next in the order of the search; coprime to side²
uniform int seed;

layout(location = 0) out vec4 out_position;  // of the pixel with the least weight; w: how many pixels of the tile need a record
layout(location = 1) out vec4 out_normal;    // its shading normal, geometric normal octahedral .x
layout(location = 2) out vec4 out_rest;      // geometric normal octahedral .y, its effective weight, how many pixels of the tile see a surface, triangle

// A random number from a tile (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering": pcg).
uint random(uvec2 tile)
{
    uint v = tile.x + tile.y * 16384u + uint(seed) * 268435399u;
    v = v * 747796405u + 2891336453u;
    v = ((v >> ((v >> 28u) + 4u)) ^ v) * 277803737u;
    return (v >> 22u) ^ v;
}

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
    // the search starts at random, so that no place in the tile is preferred; of equal pixels the first one is taken
    int count = side * side, i = int(random(uvec2(tile + first_tile)) % uint(count)), worst = i;
    float least = NOTHING_SEEN, needy = 0.0, seen = 0.0;
    for (int n = 0; n < count; ++n)
    {
        i += step_size;
        i = i >= count ? i - count : i;
        ivec2 pixel = corner + texel_of_square(i, side);
        bool there = all(greaterThanEqual(pixel, begin)) && all(lessThan(pixel, past));
        float w = there ? weight_at(pixel) : NOTHING_SEEN;
        seen += w < NOTHING_SEEN ? 1.0 : 0.0;
        needy += w < tolerance ? 1.0 : 0.0;
        worst = w < least ? i : worst;
        least = min(w, least);
    }
    ivec2 pixel = min(corner + texel_of_square(worst, side), past - 1) * pixel_stride;
    out_position = vec4(texel_at(position, pixel).xyz, needy);
    out_normal = texel_at(normal, pixel);
    out_rest = vec4(texel_at(albedo, pixel).w, least, seen, texel_at(emission, pixel).w);
}
