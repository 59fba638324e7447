// Where records are missing: of each tile of the screen, the pixel that is served worst (Jones 2010, section 2.3).
#include "indirect/asking.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform sampler2D albedo;
uniform sampler2D emission;
uniform sampler2D sums;      // Σ k·E, Σ k
uniform sampler2D weight;    // Σ of raw w, NOTHING_SEEN where nothing is seen; Σ k·Y²
uniform int every;           // of the g-buffer's pixels that the sums are of
uniform int side;            // pixels of a tile
uniform int stride;          // coprime to side²: the order in which a tile's pixels are looked at
uniform int seed;

layout(location = 0) out vec4 out_position;  // of the worst pixel; w: how many pixels of the tile ask
layout(location = 1) out vec4 out_normal;    // its shading normal, geometric normal octahedral .x
layout(location = 2) out vec4 out_rest;      // geometric normal octahedral .y, its Σw as it counts, pixels of the tile that see anything, triangle

// A random number from a tile (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering": pcg).
uint random(uvec2 tile)
{
    uint v = tile.x + tile.y * 16384u + uint(seed) * 268435399u;
    v = v * 747796405u + 2891336453u;
    v = ((v >> ((v >> 28u) + 4u)) ^ v) * 277803737u;
    return (v >> 22u) ^ v;
}

void main()
{
    ivec2 tile = ivec2(gl_FragCoord.xy), corner = tile * side, size = textureSize(weight, 0);
    // of equals the first one wins, and which comes first is drawn by lot
    int count = side * side, i = int(random(uvec2(tile)) % uint(count)), worst = i;
    float least = NOTHING_SEEN, asking = 0.0, seen = 0.0;
    for (int n = 0; n < count; ++n)
    {
        i += stride;
        i = i >= count ? i - count : i;
        ivec2 pixel = corner + ivec2(i % side, i / side);
        bool there = all(lessThan(pixel, size));
        float w = there ? counted_weight(texelFetch(weight, pixel, 0).rg, texelFetch(sums, pixel, 0)) : NOTHING_SEEN;
        seen += w < NOTHING_SEEN ? 1.0 : 0.0;
        asking += w < tolerance ? 1.0 : 0.0;
        worst = w < least ? i : worst;
        least = min(w, least);
    }
    ivec2 pixel = min(corner + ivec2(worst % side, worst / side), size - 1) * every;
    out_position = vec4(texelFetch(position, pixel, 0).xyz, asking);
    out_normal = texelFetch(normal, pixel, 0);
    out_rest = vec4(texelFetch(albedo, pixel, 0).w, least, seen, texelFetch(emission, pixel, 0).w);
}
