// Where records are missing: the pixel of least effective weight in each tile of the screen (Jones 2010, section 2.3).
#include "indirect/effective_weight.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform sampler2D albedo;
uniform sampler2D emission;
uniform sampler2D sums;      // Σ k·E, Σ k
uniform sampler2D weight;    // Σ of raw w, NOTHING_SEEN where nothing is seen; Σ k·Y²
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
uniform int borrow;          // how many pixels that ask, of those around one, are so few that they borrow; 0: none do

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

// Deviation over mean of what records say of a pixel, beyond which it does not borrow: of those that reach it, and of those that only
// lie near. Of two that lend, one may be 4 times as bright as the other.
const float BADLY = 0.15;
const float LENT = 0.6;

// What is lent may be so many times as bright as the pixels beside it that records reach, or as dark; and differ from each of
// them by so much of what errors there are judged by, or at bright places: beside strong light, what looks alike can be far off.
const float APART = 8.0;
const float FAR_OFF = 0.5;
const float FLUSH = 0.95;  // cosine: pixels beside one whose normals make less of an angle lie on its surface

float weight_at(ivec2 pixel)
{
    float share = 1.0;
#if REFINED
    share = texel_at(reach, pixel).r;
#endif
    return effective_weight(texel_at(weight, pixel).rg, texel_at(sums, pixel), share);
}

// Whether what is lent to a pixel fits to what records say of the pixels beside it on its surface: one record alone may lend, of
// another shelf, and nothing contradicts it.
bool fits(ivec2 pixel, float lent)
{
    vec3 n = texel_at(normal, pixel * pixel_stride).xyz;
    float darkest = 1e30, brightest = 0.0;
    for (int i = 0; i < 9; ++i)
    {
        ivec2 at = clamp(pixel + texel_of_square(i, 3) - 1, max(begin, 0), min(end, textureSize(weight, 0)) - 1);
        vec2 w = texel_at(weight, at).rg;
        if (w.r <= 0.0 || w.r >= NOTHING_SEEN || dot(texel_at(normal, at * pixel_stride).xyz, n) < FLUSH) continue;
        float Y = deviation_and_mean(w, texel_at(sums, at)).y;
        darkest = min(darkest, Y);
        brightest = max(brightest, Y);
    }
    if (darkest > brightest) return true;
    bool alike = max(lent, luminance_floor) * APART >= darkest && lent <= APART * max(brightest, luminance_floor);
    return alike && max(lent - darkest, brightest - lent) <= FAR_OFF * error_scale(max(brightest, BRIGHT * luminance_floor));
}

// Whether a pixel that asks lies in so small a group of such pixels that it does with what records beside it lend. Of every other
// pixel, those of half as wide a window are looked at, and half as many are few.
bool borrows(ivec2 pixel)
{
    int around = pixel_stride == 1 ? 2 : 1, few = pixel_stride == 1 ? borrow : borrow / 2, asking = 0;
    // where records contradict each other badly, or none is near to borrow from, a record is needed
    vec4 said = texel_at(sums, pixel);
    vec2 told = deviation_and_mean(texel_at(weight, pixel).rg, said);
    bool reached = texel_at(weight, pixel).r > 0.0, lent = said.a > TOLD && told.x <= LENT * max(told.y, luminance_floor);
    if (!reached && lent) lent = fits(pixel, told.y);
    if (reached ? weight_at(pixel) < tolerance * spread / BADLY : !lent) few = 0;
    for (int i = 0; few > 0 && i < (2 * around + 1) * (2 * around + 1); ++i)
    {
        ivec2 at = pixel + texel_of_square(i, 2 * around + 1) - around;
        asking += weight_at(clamp(at, max(begin, 0), min(end, textureSize(weight, 0)) - 1)) < tolerance ? 1 : 0;
    }
    return few > 0 && asking <= few;
}

int worst;                  // what `search` finds: the pixel of least weight, by its number in the tile
float least, needy, seen;   // its weight, and how many pixels need a record, and see a surface

// Looks at all `count` pixels of a tile whose first one is at `corner`, from number i on. Of equal pixels the first one is taken.
void search(ivec2 corner, int i, int count, bool borrowing)
{
    ivec2 past = min(end, textureSize(weight, 0));
    worst = i;
    least = NOTHING_SEEN;
    needy = seen = 0.0;
    for (int n = 0; n < count; ++n)
    {
        i += step_size;
        i = i >= count ? i - count : i;
        ivec2 pixel = corner + texel_of_square(i, side);
        bool there = all(greaterThanEqual(pixel, begin)) && all(lessThan(pixel, past));
        float w = there ? weight_at(pixel) : NOTHING_SEEN;
        if (borrowing && w < tolerance && borrows(pixel)) w = tolerance;
        seen += w < NOTHING_SEEN ? 1.0 : 0.0;
        needy += w < tolerance ? 1.0 : 0.0;
        worst = w < least ? i : worst;
        least = min(w, least);
    }
}

void main()
{
    ivec2 tile = ivec2(gl_FragCoord.xy), corner = tile * side, past = min(end, textureSize(weight, 0));
    // the search starts at random, so that no place in the tile is preferred
    int count = side * side, first = int(random(uvec2(tile + first_tile)) % uint(count));
    search(corner, first, count, false);
    if (needy > 0.0) search(corner, first, count, true);  // software renderers would look around every pixel, needy or not
    ivec2 pixel = min(corner + texel_of_square(worst, side), past - 1) * pixel_stride;
    out_position = vec4(texel_at(position, pixel).xyz, needy);
    out_normal = texel_at(normal, pixel);
    out_rest = vec4(texel_at(albedo, pixel).w, least, seen, texel_at(emission, pixel).w);
}
