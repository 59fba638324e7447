// The surface cache: indirect irradiance at points spread over all surfaces, as scene/lattice.py cuts them into cells.
#include "lib/bvh.glsl"

uniform sampler2D surface_triangles;  // three texels a triangle: first corner and steps n; edges from it, and its first cell
uniform sampler2D surface_cells;      // two texels a cell, one for each side: the numbers of its corners' values (-1: none); 0,
                                      // or where something stands on it 1 + the corner that is hidden from both others, or ANY
uniform sampler2D surface_values;     // rgb E in W/m²
uniform float surface_offset;         // metres: how far the corners' points lie above the surface, and within the cell

const int ANY = 3;

// The values that speak for a place, and how much; where none does, all weights are 0.
struct Look
{
    ivec3 values;
    vec3 weights;
};

// What speaks for the point p of a triangle, on the side of it that g, unit, points to.
Look surface_look(int triangle, vec3 p, vec3 g)
{
    ivec2 at = table_texel(triangle, 3, 0);
    vec4 corner = texelFetch(surface_triangles, at, 0), right = texelFetch(surface_triangles, at + ivec2(1, 0), 0);
    vec3 up = texelFetch(surface_triangles, at + ivec2(2, 0), 0).xyz, away = p - corner.xyz;
    vec3 normal = cross(right.xyz, up);
    vec2 uv = clamp(vec2(dot(cross(away, up), normal), dot(cross(right.xyz, away), normal)) / dot(normal, normal), 0.0, 1.0);
    uv *= corner.w / max(uv.x + uv.y, 1.0);
    int n = int(corner.w), j = min(int(uv.y), n - 1), i = min(int(uv.x), n - 1 - j);
    vec2 f = uv - vec2(i, j);
    bool odd = f.x + f.y > 1.0 && i + j < n - 1;
    vec3 weights = max(odd ? vec3(f.x + f.y - 1.0, 1.0 - f) : vec3(1.0 - f.x - f.y, f), 0.0);
    int cell = int(right.w) + j * (2 * n - j) + 2 * i + int(odd);
    bool other = dot(normal, g) < 0.0;
    vec4 found = texelFetch(surface_cells, table_texel(cell, 2, int(other)), 0);
    weights = mix(weights, vec3(0.0), lessThan(found.xyz, vec3(0.0)));

    // Where something stands on the cell, what it hides from p does not count. Corners that see each other are seen together, and
    // those that don't are not: the nearest one seen decides for all, unless it is not so simple (ANY). This is seldom needed, and
    // software renderers run a loop only where one needs it.
    vec2 first = vec2(i, j) + (odd ? vec2(1.0) : vec2(0.0)), way = odd ? vec2(-1.0) : vec2(1.0);
    vec3 middle = corner.xyz + (right.xyz * (first.x + way.x / 3.0) + up * (first.y + way.y / 3.0)) / corner.w;
    int apart = int(found.w) - 1;
    vec3 untold = weights;
    while (apart >= 0 && untold.x + untold.y + untold.z > 0.0)
    {
        int k = untold.x >= max(untold.y, untold.z) ? 0 : untold.y >= untold.z ? 1 : 2;
        vec2 c = first + way * vec2(k == 1, k == 2);
        vec3 point = corner.xyz + (right.xyz * c.x + up * c.y) / corner.w, inward = middle - point;
        point += inward * min(surface_offset / length(inward), 0.5);
        bool seen = bvh_free(p + surface_offset * g, point + surface_offset * g);
        vec3 alike = vec3(k == 0, k == 1, k == 2);
        if (apart < ANY && k != apart) alike = 1.0 - vec3(apart == 0, apart == 1, apart == 2);
        if (!seen) weights *= 1.0 - alike;
        if (seen && apart < ANY) weights *= alike;
        untold *= seen && apart < ANY ? vec3(0.0) : 1.0 - alike;
    }
    float sum = weights.x + weights.y + weights.z;
    return Look(ivec3(max(found.xyz, 0.0)), sum > 0.0 ? weights / sum : vec3(0.0));
}

vec3 surface_value(int i)
{
    return texelFetch(surface_values, table_texel(i), 0).rgb;
}

// Indirect irradiance there, W/m².
vec3 surface_irradiance(int triangle, vec3 p, vec3 g)
{
    Look look = surface_look(triangle, p, g);
    return look.weights.x * surface_value(look.values.x) + look.weights.y * surface_value(look.values.y) +
           look.weights.z * surface_value(look.values.z);
}
