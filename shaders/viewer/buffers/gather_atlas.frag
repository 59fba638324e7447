// The radiance over the hemispheres of the last batch of records, one cell for each record.
#include "lib/display.glsl"
#include "lighting/sky.glsl"
#include "viewer/tiles.glsl"

uniform sampler2D radiance;
uniform float gain;     // the exposure as a factor
uniform sampler2D table;   // directions of a cell's texels, in a record's frame
uniform sampler2D frames;  // texels (i, 0..2): record i's frame

layout(location = 0) out vec4 out_color;

void main()
{
    out_color = vec4(ground, 1.0);
    ivec2 texel;
    int i = tile_at(texel);
    if (i < 0) return;
    vec4 hit = texelFetch(radiance, corner_of(i) + texel, 0);
    mat3 frame = mat3(texelFetch(frames, ivec2(i, 0), 0).xyz, texelFetch(frames, ivec2(i, 1), 0).xyz,
                      texelFetch(frames, ivec2(i, 2), 0).xyz);
    vec3 behind = sky_along(texelFetch(table, texel, 0), sky_frame(frame));
    out_color.rgb = display((hit.a > 0.0 ? hit.rgb : behind) * gain);
}
