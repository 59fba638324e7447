// Upsampling of pixels that lie on one surface with the square of four coarse pixels around them: linear interpolation of those.
#include "lib/texel.glsl"

uniform sampler2D irradiance;  // of the coarse pixels, from squares.frag: E and Σw; linearly filtered
uniform sampler2D planes;      // likewise
uniform float pixel;           // size of a pixel at distance 1, in metres

const float MAX_RISE = 0.5;  // how far a pixel's point may lie off the square's plane, in sizes of a pixel there

// E and Σw at the pixel `at`, whose place and depth are p; 0 where it does not lie `between` four of one surface.
// none: whether none of the four has a record: a hole.
vec4 between_four(ivec2 at, vec4 p, out bool between, out bool none)
{
    vec4 plane = texel_at(planes, at / 2);
    none = plane == vec4(0.0, 0.0, 0.0, 1.0);
    between = plane.xyz != vec3(0.0) && abs(dot(plane.xyz, p.xyz) - plane.w) <= MAX_RISE * pixel * p.w;
    vec2 place = (0.5 * vec2(at) + 0.5) / vec2(textureSize(irradiance, 0));
    return between ? textureLod(irradiance, place, 0.0) : vec4(0.0);
}
