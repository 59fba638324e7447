// How high the gap is that a pixel lies in, where something that faces its surface hangs close above it, as a plate's rim above a table.
#include "generated/constants.glsl"
#include "lib/octahedral.glsl"
#include "lib/normals.glsl"
#include "lib/texel.glsl"
#include "lib/rays/bvh.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform sampler2D albedo;
uniform int stride;          // one pixel of each square of so many is looked at
uniform ivec2 corner;        // of what is drawn, in pixels from that of the whole picture
uniform ivec2 first;         // square that is looked at
uniform vec3 eye;
uniform float height;        // of the highest gap, metres at distance 1 from the eye
uniform float near;          // metres above the surface from where rays begin

layout(location = 0) out float out_gap;  // the gap's height in metres; 0: the pixel lies in none

const int AROUND = 8;      // rays at 45 degrees, beside the one straight up
const float FACING = 0.5;  // cosine between the normals from which on it faces the surface, and is no wall that stands there

void main()
{
    ivec2 pixel = pixel_of_square(first + ivec2(gl_FragCoord.xy), stride) - corner;
    out_gap = 0.0;
    if (pixel != clamp(pixel, ivec2(0), textureSize(position, 0) - 1)) return;
    vec4 p = texel_at(position, pixel);
    vec3 g = octahedral_decode(vec2(texel_at(normal, pixel).w, texel_at(albedo, pixel).w));
    vec3 t = perpendicular(g), b = cross(g, t);
    float most = p.w > 0.0 ? height * distance(p.xyz, eye) : 0.0, least = most;
    for (int i = 0; i <= AROUND && most > 0.0; ++i)
    {
        float angle = 2.0 * PI * float(i) / float(AROUND);
        vec3 d = i == AROUND ? g : normalize(g + cos(angle) * t + sin(angle) * b);
        float farthest = least / dot(d, g);
        Hit hit = bvh_between(p.xyz + near * g, d, 0.0, farthest);
        vec3 a = triangle_point(hit.triangle, 0), u = triangle_point(hit.triangle, 1) - a, v = triangle_point(hit.triangle, 2) - a;
        bool over = hit.t < farthest && abs(dot(normalize(cross(u, v)), g)) >= FACING;
        least = over ? min(least, hit.t * dot(d, g)) : least;
    }
    out_gap = least < most ? near + least : 0.0;
}
