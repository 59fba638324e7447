// Candidates for virtual point lights: the first hits of rays from lights (METHOD.md, 3.8). A fragment is a ray; each light has
// `sets` rows. The rays of each row, and those of all rows of a light, are uniform over the light's cone, the sphere, or the
// window of a directional light.
#include "generated/constants.glsl"
#include "lib/rays/bvh.glsl"
#include "lib/normals.glsl"

uniform sampler2D lights;  // three texels per light: position, w 0; axis of the cone, 1 - cosine of the half angle (sphere: 2).
                          // Directional lights: corner of the window, w 1; first edge; second edge
uniform float rays;       // rays per row
uniform int further;      // rays from each first hit of a directional light's rays
uniform int sets;         // rows per light
uniform float near;       // least distance of a hit, metres

layout(location = 0) out vec4 out_place;   // position; distance from a point light, or length of the longest further ray; metres
layout(location = 1) out vec4 out_normal;  // geometric normal on the side of the light; triangle
layout(location = 2) out vec4 out_share;   // barycentric coordinates; cosθ/d², or cosθ for a directional light; 0: no hit

void main()
{
    int row = int(gl_FragCoord.y);
    ivec2 light = ivec2(0, row / sets);
    float set = float(row % sets), number = floor(gl_FragCoord.x), fraction = (number + (set + 0.5) / float(sets)) / rays;
    vec4 position = texel_at(lights, light), axis = texel_at(lights, light + ivec2(1, 0));
    bool parallel = position.w > 0.5;
    vec3 edge = texel_at(lights, light + ivec2(2, 0)).xyz, origin = position.xyz, right = perpendicular(axis.xyz);

    // a spiral about the axis with points of equal solid angle (Swinbank and Purser 2006)
    float height = axis.w * fraction, r = sqrt(max(height * (2.0 - height), 0.0));  // height of a spherical cap
    float angle = GOLDEN_ANGLE * number + 2.0 * PI * fract(set * PLASTIC);
    vec3 d = r * (cos(angle) * right + sin(angle) * cross(axis.xyz, right)) + (1.0 - height) * axis.xyz;
    if (parallel)
    {
        origin += fraction * axis.xyz + fract(number * GOLDEN + set * PLASTIC) * edge;
        d = normalize(cross(edge, axis.xyz));
    }
    Hit hit = bvh_between(origin, d, near, FARTHEST_HIT);
    vec3 a = triangle_point(hit.triangle, 0), b = triangle_point(hit.triangle, 1), c = triangle_point(hit.triangle, 2);
    vec3 g = normalize(cross(b - a, c - a));
    g = dot(g, d) > 0.0 ? -g : g;
    vec3 end = mat3(a, b, c) * hit.barycentric;  // exactly on the triangle, for any distance of the light
    float cosine = hit.t < FARTHEST_HIT ? -dot(g, d) : 0.0, longest = hit.t;
    for (int i = 0; i < further && cosine > 0.0 && (i == 0 || longest < FARTHEST_HIT); ++i)
    {
        float z = 1.0 - 2.0 * fract(number * PLASTIC + float(i) * GOLDEN), turn = angle + float(i) * GOLDEN_ANGLE;
        vec3 random_direction = vec3(sqrt(1.0 - z * z) * vec2(cos(turn), sin(turn)), z);
        float t = bvh_between(end + 1e-4 * hit.t * g, normalize(g + 0.999 * random_direction), 0.0, FARTHEST_HIT).t;
        longest = i == 0 ? t : max(longest, t);
    }
    out_place = vec4(end, longest);
    out_normal = vec4(g, float(hit.triangle));
    out_share = vec4(hit.barycentric, parallel ? cosine : cosine / (hit.t * hit.t));
}
