// Copies the sums of records and marks holes in the depth buffer, so that later draws touch no other pixel (METHOD.md, 8.2). While
// coarse light lights the records, all surfaces are marked.
#include "generated/constants.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D sums;      // Σ k·E, Σ k of the records
uniform bool coarse;         // true while coarse light lights the records
uniform int pixel_stride;    // pixels of the g-buffer per pixel of the sums, in x and y

layout(location = 0) out vec4 out_sums;

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    out_sums = texel_at(sums, at);
    gl_FragDepth = (coarse || out_sums.a <= COVERED) && texel_at(position, at * pixel_stride).w > 0.0 ? 1.0 : 0.0;
}
