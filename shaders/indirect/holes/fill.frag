// Fills holes: pixels that mark.frag has marked take the filtered probes of the cells around them, on their surface (METHOD.md, 8.2).
// Without such a cell, they remain for surface.frag, or else take the light of cells on other surfaces. Marked pixels with records take
// the mean of the records' and the cells' light.
#include "generated/constants.glsl"
#include "lib/same_surface.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;       // g-buffer
uniform sampler2D normal;
uniform sampler2D sums;           // Σ k·E, Σ k of the records
uniform sampler2D cell_position;  // of the cells: world space; w: depth, 0 without a surface
uniform sampler2D cell_normal;
uniform sampler2D light;          // of the cells: filtered Σ E and number of samples
uniform int side;                 // width of a cell in pixels
uniform bool surface;             // true if the surface cache fills holes without a cell on their surface
uniform int pixel_stride;         // pixels of the g-buffer per pixel of the sums, in x and y

layout(location = 0) out vec4 out_sums;  // E and 1; 0 without any light

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy) * pixel_stride, last = textureSize(light, 0) - 1;
    vec3 p = texel_at(position, pixel).xyz, n = texel_at(normal, pixel).xyz;
    vec2 place = (vec2(pixel) - float(side / 2)) / float(side);  // in cells; a cell's pixel is a whole number
    ivec2 nearest = ivec2(floor(place + 0.5));
    vec4 other = vec4(0.0);  // of cells on other surfaces
    out_sums = vec4(0.0);
    for (int i = 0; i < 9; ++i)
    {
        ivec2 cell = nearest + ivec2(i % 3, i / 3) - 1, inside = clamp(cell, ivec2(0), last);
        vec4 q = texel_at(cell_position, inside), E = texel_at(light, inside);
        vec3 m = texel_at(cell_normal, inside).xyz;
        if (E.a == 0.0) continue;
        vec4 share = bilateral_weight(p, n, q.xyz, m, distance(vec2(cell), place)) * vec4(E.rgb / E.a, 1.0);
        if (same_surface(p, n, q.xyz, m)) out_sums += share;
        else other += share;
    }
    vec4 records = texel_at(sums, ivec2(gl_FragCoord.xy));
    bool covered = records.a > COVERED;
    if (surface && !covered && out_sums.a == 0.0) discard;
    out_sums = out_sums.a > 0.0 || covered ? out_sums : other;
    out_sums = out_sums.a > 0.0 ? out_sums / out_sums.a : vec4(0.0);
    if (covered) out_sums = (records / records.a + out_sums) / (1.0 + out_sums.a);
}
