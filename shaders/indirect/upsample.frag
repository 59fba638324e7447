// Upsampling, first draw: pixels that lie on one surface with the square of four coarse pixels around them take the linear
// interpolation of those. The other pixels are marked in the depth buffer, for upsample_search.frag.
#include "generated/constants.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;    // g-buffer, of all pixels
uniform sampler2D irradiance;  // of the coarse pixels, from upsample_squares.frag; linearly filtered
uniform sampler2D planes;      // likewise
uniform float pixel;           // size of a pixel at distance 1, in metres

layout(location = 0) out vec4 out_sums;    // E and 1
layout(location = 1) out vec2 out_weight;  // Σw, and Y²: no inter-record variance

const float MAX_RISE = 0.5;  // how far a pixel's point may lie off the square's plane, in sizes of a pixel there

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), first = at / 2;
    vec4 p = texel_at(position, at), plane = texel_at(planes, first);
    bool none = plane == vec4(0.0, 0.0, 0.0, 1.0);  // no record covers any of the four: a hole
    bool between = plane.xyz != vec3(0.0) && abs(dot(plane.xyz, p.xyz) - plane.w) <= MAX_RISE * pixel * p.w;
    vec2 place = (0.5 * vec2(at) + 0.5) / vec2(textureSize(irradiance, 0));
    vec4 E = between ? textureLod(irradiance, place, 0.0) : vec4(0.0);
    float Y = dot(E.rgb, LUMINANCE);
    out_sums = vec4(E.rgb, between ? 1.0 : 0.0);
    out_weight = p.w == 0.0 ? vec2(NOTHING_SEEN, 0.0) : vec2(E.a, Y * Y);
    gl_FragDepth = between || none || p.w == 0.0 ? 0.0 : 1.0;
}
