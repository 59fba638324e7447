// The ends of rays from point lights: `sets` rows a light, a texel a ray. The rays of each row are spread evenly over the light's
// cone, or over the sphere, and so are the rays of all its rows together.
#include "generated/constants.glsl"
#include "lib/rays/bvh.glsl"
#include "lib/normals.glsl"

uniform sampler2D lamps;  // two texels each: where it is; the axis of its cone, and 1 - the cosine of half its angle, 2 for all around
uniform float rays;       // of each row
uniform int sets;
uniform float near;       // metres: nothing nearer casts a shadow

layout(location = 0) out vec4 out_place;   // metres; how far from the lamp, FARTHEST_HIT: nothing is lit
layout(location = 1) out vec4 out_normal;  // geometric, turned to the lamp; the triangle's number
layout(location = 2) out vec4 out_share;   // of the triangle's corners

void main()
{
    int row = int(gl_FragCoord.y);
    ivec2 lamp = ivec2(0, row / sets);
    float set = float(row % sets), number = floor(gl_FragCoord.x);
    vec3 from = texelFetch(lamps, lamp, 0).xyz;
    vec4 axis = texelFetch(lamps, lamp + ivec2(1, 0), 0);
    vec3 right = perpendicular(axis.xyz);

    // a spiral about the axis, of which each turn takes up as much of the sphere (Swinbank and Purser 2006)
    float down = axis.w * (number + (set + 0.5) / float(sets)) / rays, r = sqrt(max(down * (2.0 - down), 0.0));
    float angle = GOLDEN_ANGLE * number + 2.0 * PI * fract(set * PLASTIC);
    vec3 d = r * (cos(angle) * right + sin(angle) * cross(axis.xyz, right)) + (1.0 - down) * axis.xyz;
    Hit hit = bvh_closest(from, d, near);
    vec3 a = triangle_point(hit.triangle, 0), b = triangle_point(hit.triangle, 1), c = triangle_point(hit.triangle, 2);
    vec3 g = normalize(cross(b - a, c - a));
    out_place = vec4(from + hit.t * d, hit.t);
    out_normal = vec4(dot(g, d) > 0.0 ? -g : g, float(hit.triangle));
    out_share = vec4(hit.share, 0.0);
}
