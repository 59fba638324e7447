// The share of a stratum that sees the sky: by RAYS further rays where neighbouring strata differ and the place is not
// open, else by the stratum's own ray. irrsplat/gather/sky_share.py computes it with Embree.
#include "generated/constants.glsl"
#include "lib/rays/bvh.glsl"

uniform sampler2D radiance;     // the atlas: a distance as w (0: the sky)
uniform sampler2D frames;       // texels (i, 0..2): tangent, bitangent and normal of record i, (i, 4): its eye
uniform sampler2D closer_rays;  // RAYS texels a stratum: directions in a record's frame; w: azimuths to either side that count as around
uniform ivec2 cell;             // azimuths and elevations of a record
uniform int columns;            // cells per row
uniform ivec2 step;             // between the strata that sample the openness of the place
uniform float most;             // greatest share of these that see the sky where further rays are traced

layout(location = 0) out float out_share;

int free(ivec2 corner, ivec2 stratum)
{
    return texel_at(radiance, corner + stratum).a > 0.0 ? 0 : 1;
}

void main()
{
    ivec2 place = ivec2(gl_FragCoord.xy) / cell, corner = place * cell, inside = ivec2(gl_FragCoord.xy) - corner;
    // without the stratum itself, so that the choice leaves no bias
    int own = free(corner, inside), seen = -own, around = -1;
    for (int y = max(inside.y - NEAR, 0); y <= min(inside.y + NEAR, cell.y - 1); ++y)
    {
        int wide = int(texel_at(closer_rays, ivec2(0, y)).w);
        for (int x = inside.x - wide; x <= inside.x + wide; ++x)
            seen += free(corner, ivec2(x < 0 ? x + cell.x : x < cell.x ? x : x - cell.x, y));
        around += 2 * wide + 1;
    }
    // loops, since software renderers run them only where a fragment needs it
    int open = 0, tested = 0, height = seen > 0 && seen < around ? cell.y : 0;
    for (int y = 0; y < height; y += step.y)
        for (int x = 0; x < cell.x; x += step.x)
        {
            open += free(corner, ivec2(x, y));
            ++tested;
        }
    int rays = tested > 0 && float(open) <= most * float(tested) ? RAYS : 0, found = 0, record = place.y * columns + place.x;
    mat3 frame = mat3(texel_at(frames, ivec2(record, 0)).xyz, texel_at(frames, ivec2(record, 1)).xyz,
                      texel_at(frames, ivec2(record, 2)).xyz);
    vec3 eye = texel_at(frames, ivec2(record, 4)).xyz;
    for (int j = 0; j < rays; ++j)
    {
        vec3 d = normalize(frame * texel_at(closer_rays, ivec2(inside.x * RAYS + j, inside.y)).xyz);
        found += bvh_between(eye, d, 0.0, FARTHEST_HIT).t < FARTHEST_HIT ? 0 : 1;
    }
    out_share = rays > 0 ? float(found) / float(RAYS) : float(own);
}
