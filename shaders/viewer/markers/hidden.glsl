// The test if the visible surface at a pixel hides a point.
#include "lib/normals.glsl"

uniform sampler2D position;  // g-buffer; w depth along the view axis, 0 without a surface
uniform sampler2D normal;
uniform sampler2D albedo;
uniform float pixel;         // size of a pixel at distance 1, in metres

// True if p lies behind the plane of the visible surface at the pixel, by more than a pixel's size. A test of depths alone is not
// enough: at grazing angles depths differ much from pixel to pixel, and a surface would hide its own markers.
bool hidden(vec3 p, ivec2 at)
{
    at = clamp(at, ivec2(0), textureSize(position, 0) - 1);
    vec4 q = texelFetch(position, at, 0);
    vec3 g = octahedral_decode(vec2(texelFetch(normal, at, 0).w, texelFetch(albedo, at, 0).w));
    return q.w > 0.0 && dot(p - q.xyz, g) < -pixel * q.w;
}
