// Whether a point is hidden behind what a pixel sees.
#include "lib/octahedral.glsl"

uniform sampler2D position;  // g-buffer; w depth along the view axis, 0 where nothing is seen
uniform sampler2D normal;
uniform sampler2D albedo;
uniform float pixel;         // size of a pixel at distance 1, in metres

// Whether p lies behind the plane that the pixel sees, by more than a pixel's size. Depths alone won't do: they differ much from
// pixel to pixel where a surface is seen at a grazing angle, and its own markers would hide in it.
bool hidden(vec3 p, ivec2 at)
{
    at = clamp(at, ivec2(0), textureSize(position, 0) - 1);
    vec4 q = texelFetch(position, at, 0);
    vec3 g = octahedral_decode(vec2(texelFetch(normal, at, 0).w, texelFetch(albedo, at, 0).w));
    return q.w > 0.0 && dot(p - q.xyz, g) < -pixel * q.w;
}
