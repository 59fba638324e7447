// A part of a picture, or of four of one size, from where it was drawn to where it belongs.
#include "lib/texel.glsl"

uniform ivec2 start;  // the pixel here that is the first one there
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
    ivec2 there = ivec2(gl_FragCoord.xy) - start;
    out_0 = texel_at(part_0, there);
#if FOUR
    out_1 = texel_at(part_1, there);
    out_2 = texel_at(part_2, there);
    out_3 = texel_at(part_3, there);
#endif
}
