// Upsampling, second of three draws (METHOD.md, 8.1): a pixel on the plane of its four coarse neighbours takes their linearly
// interpolated irradiance. The depth buffer marks all other pixels for upsample_search.frag.
#include "generated/constants.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;    // g-buffer, all pixels
uniform sampler2D irradiance;  // E and Σw of coarse pixels, from upsample_squares.frag; linearly filtered
uniform sampler2D planes;      // planes of squares, from upsample_squares.frag
uniform float pixel;           // size of a pixel at distance 1, metres

layout(location = 0) out vec4 out_sums;    // E and 1
layout(location = 1) out vec2 out_weight;  // Σw, and Y²: no inter-record variance

const float MAX_RISE = 0.5;  // greatest distance of a pixel's point from the square's plane, in sizes of a pixel at this depth

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), square = at / 2;
    vec4 p = texel_at(position, at), plane = texel_at(planes, square);
    bool hole = plane == vec4(0.0, 0.0, 0.0, 1.0);  // no record covers the four pixels
    bool between = plane.xyz != vec3(0.0) && abs(dot(plane.xyz, p.xyz) - plane.w) <= MAX_RISE * pixel * p.w;
    vec2 uv = (0.5 * vec2(at) + 0.5) / vec2(textureSize(irradiance, 0));
    vec4 E = between ? textureLod(irradiance, uv, 0.0) : vec4(0.0);
    float Y = dot(E.rgb, LUMINANCE);
    out_sums = vec4(E.rgb, between ? 1.0 : 0.0);
    out_weight = p.w == 0.0 ? vec2(NOTHING_SEEN, 0.0) : vec2(E.a, Y * Y);
    gl_FragDepth = between || hole || p.w == 0.0 ? 0.0 : 1.0;
}
