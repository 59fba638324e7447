// What the records of the last batch saw, a cell each, from the upper left on.
#include "lib/display.glsl"
#include "lighting/sky.glsl"

uniform sampler2D radiance;
uniform vec2 cell;      // size of a cell in texels
uniform int columns;    // cells per row of the atlas
uniform int count;      // how many cells are in use
uniform vec4 place;     // upper left corner in the target, texels per pixel, pixels between cells
uniform int across;     // cells per row of the target
uniform float gain;     // the exposure as a factor
uniform sampler2D table;   // of a cell: directions in a record's frame
uniform sampler2D frames;  // texels (i, 0..2): record i's frame
uniform vec3 ground;    // around the cells

layout(location = 0) out vec4 out_color;

void main()
{
    out_color = vec4(ground, 1.0);
    vec2 q = vec2(gl_FragCoord.x - place.x, place.y - gl_FragCoord.y) * place.z, pitch = cell + place.w * place.z;
    ivec2 at = ivec2(floor(q / pitch));
    vec2 inside = q - vec2(at) * pitch;
    int i = at.y * across + at.x;
    if (at.x < 0 || at.y < 0 || at.x >= across || i >= count || any(greaterThanEqual(inside, cell))) return;
    inside.y = cell.y - inside.y;
    ivec2 texel = ivec2(min(inside, cell - 0.5));
    vec4 seen = texelFetch(radiance, ivec2(i % columns, i / columns) * ivec2(cell) + texel, 0);
    mat3 frame = mat3(texelFetch(frames, ivec2(i, 0), 0).xyz, texelFetch(frames, ivec2(i, 1), 0).xyz,
                      texelFetch(frames, ivec2(i, 2), 0).xyz);
    vec3 behind = sky_along(texelFetch(table, texel, 0), sky_frame(frame));
    out_color.rgb = display((seen.a > 0.0 ? seen.rgb : behind) * gain);
}
