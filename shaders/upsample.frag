// Sums of every other pixel, brought to those between; a pixel that is on another surface than its square is marked by its depth.
uniform sampler2D position;    // g-buffer, of all pixels
uniform sampler2D irradiance;  // of every other one, as upsample_squares.frag has it; filtered
uniform sampler2D planes;
uniform sampler2D sums;        // Σ k·E, Σ k of those
uniform sampler2D weight;
uniform float pixel;           // size of a pixel at distance 1, in metres

layout(location = 0) out vec4 out_sums;    // E and 1
layout(location = 1) out vec2 out_weight;  // Σw of a neighbour, and the mean of its Y²

const float OFF = 0.5;  // pixels by which a pixel may lie off the square's plane

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy), first = at / 2;
    vec4 p = texelFetch(position, at, 0), plane = texelFetch(planes, first, 0);
    bool between = plane.xyz != vec3(0.0) && abs(dot(plane.xyz, p.xyz) - plane.w) <= OFF * pixel * p.w;
    vec2 place = (0.5 * vec2(at) + 0.5) / vec2(textureSize(irradiance, 0));
    out_sums = between ? textureLod(irradiance, place, 0.0) : vec4(0.0);
    vec2 w = texelFetch(weight, first, 0).rg;
    out_weight = p.w == 0.0 ? vec2(NOTHING_SEEN, 0.0) : vec2(w.r, w.g / max(texelFetch(sums, first, 0).a, 1e-20));
    gl_FragDepth = between || p.w == 0.0 ? 0.0 : 1.0;
}
