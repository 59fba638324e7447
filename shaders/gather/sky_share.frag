// The visible share of the sky in each stratum (METHOD.md, 3.4). If neighbouring strata differ and little of the sky is visible,
// RAYS visibility rays estimate it, else the stratum's ray. irrsplat/gather/sky_share.py is the version for Embree.
#include "generated/constants.glsl"
#include "lib/rays/bvh.glsl"

uniform sampler2D radiance;     // the atlas; a: distance, metres (0: the sky)
uniform sampler2D frames;       // texels (i, 0..2): tangent, bitangent and normal of record i; (i, 4): its eye, world space
uniform sampler2D closer_rays;  // RAYS texels per stratum: directions in the record's frame; w: neighbouring azimuths per side
uniform ivec2 cell;             // azimuths and elevations of a record
uniform int columns;            // cells per row
uniform ivec2 step;             // distance, in strata, of the strata that sample the visible share of the whole sky
uniform float most;             // greatest visible share of the whole sky with visibility rays

layout(location = 0) out float out_share;

// Return 1 if the ray of a stratum meets the sky, else 0.
int sees_sky(ivec2 corner, ivec2 stratum)
{
    return texel_at(radiance, corner + stratum).a > 0.0 ? 0 : 1;
}

void main()
{
    ivec2 index = ivec2(gl_FragCoord.xy) / cell, corner = index * cell, inside = ivec2(gl_FragCoord.xy) - corner;
    // the counts exclude the stratum itself, so that the choice causes no bias
    int meets_sky = sees_sky(corner, inside), sky_strata = -meets_sky, strata = -1;
    for (int y = max(inside.y - NEAR, 0); y <= min(inside.y + NEAR, cell.y - 1); ++y)
    {
        int wide = int(texel_at(closer_rays, ivec2(0, y)).w);
        for (int x = inside.x - wide; x <= inside.x + wide; ++x)
            sky_strata += sees_sky(corner, ivec2(x < 0 ? x + cell.x : x < cell.x ? x : x - cell.x, y));
        strata += 2 * wide + 1;
    }
    // loops in place of an `if`, because software renderers run both branches of an `if`
    int sky_samples = 0, samples = 0, height = sky_strata > 0 && sky_strata < strata ? cell.y : 0;
    for (int y = 0; y < height; y += step.y)
        for (int x = 0; x < cell.x; x += step.x)
        {
            sky_samples += sees_sky(corner, ivec2(x, y));
            ++samples;
        }
    int rays = samples > 0 && float(sky_samples) <= most * float(samples) ? RAYS : 0, sky_rays = 0, record = index.y * columns + index.x;
    mat3 frame = mat3(texel_at(frames, ivec2(record, 0)).xyz, texel_at(frames, ivec2(record, 1)).xyz,
                      texel_at(frames, ivec2(record, 2)).xyz);
    vec3 eye = texel_at(frames, ivec2(record, 4)).xyz;
    for (int j = 0; j < rays; ++j)
    {
        vec3 d = normalize(frame * texel_at(closer_rays, ivec2(inside.x * RAYS + j, inside.y)).xyz);
        sky_rays += bvh_between(eye, d, 0.0, FARTHEST_HIT).t < FARTHEST_HIT ? 0 : 1;
    }
    out_share = rays > 0 ? float(sky_rays) / float(RAYS) : float(meets_sky);
}
