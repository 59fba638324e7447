// Copies a rendered part of a picture, one texture or four of equal size (FOUR), into the whole picture.
#include "lib/texel.glsl"

uniform ivec2 start;  // pixel of the whole picture where the part begins
uniform sampler2D part_0;
#if FOUR
uniform sampler2D part_1;
uniform sampler2D part_2;
uniform sampler2D part_3;
#endif

layout(location = 0) out vec4 out_0;
#if FOUR
layout(location = 1) out vec4 out_1;
layout(location = 2) out vec4 out_2;
layout(location = 3) out vec4 out_3;
#endif

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy) - start;
    out_0 = texel_at(part_0, texel);
#if FOUR
    out_1 = texel_at(part_1, texel);
    out_2 = texel_at(part_2, texel);
    out_3 = texel_at(part_3, texel);
#endif
}
