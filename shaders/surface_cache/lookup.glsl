// The surface cache: indirect irradiance at sites spread over all surfaces, looked up by the cells that tessellation.py cuts.
#include "lib/bvh.glsl"

uniform sampler2D surface_triangles;  // three texels a triangle: first corner and steps n; edges from it, and its first cell
uniform sampler2D surface_cells;      // two texels a cell, one for each side: xyz the numbers of its corners' values (-1: none);
                                      // w 0 where the corners see each other; else something stands on the cell, and w is 1 +
                                      // the one corner (0..2) that both others do not see, or 1 + HIDDEN_OTHERWISE
uniform sampler2D surface_values;     // rgb E in W/m²
uniform int surface_known;            // 0: no value is known yet, and the first triangle stands for all
uniform float surface_offset;         // metres: how far the corners' points lie above the surface, and within the cell

// Three values and their weights at a place, which sum to 1, or are all 0 where no value is known.
struct Look
{
    ivec3 values;
    vec3 weights;
};

// The values at the corners of the cell in which p lies, a point of the triangle, on the side to which the unit vector g points.
Look surface_look(int triangle, vec3 p, vec3 g)
{
    ivec2 at = table_texel(triangle * surface_known, 3, 0);
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

    // Where something stands on the cell, corners that it hides from p do not count. Corners that see each other are visible from p
    // together, and those that do not are not: so one visible corner, the one of most weight first, decides for all, unless more
    // is hidden (HIDDEN_OTHERWISE) and each is tested. A loop, as software renderers run it only where it is needed.
    vec2 first = vec2(i, j) + (odd ? vec2(1.0) : vec2(0.0)), way = odd ? vec2(-1.0) : vec2(1.0);
    vec3 middle = corner.xyz + (right.xyz * (first.x + way.x / 3.0) + up * (first.y + way.y / 3.0)) / corner.w;
    int hidden = int(found.w) - 1;
    vec3 undecided = weights;
    while (hidden >= 0 && undecided.x + undecided.y + undecided.z > 0.0)
    {
        int k = undecided.x >= max(undecided.y, undecided.z) ? 0 : undecided.y >= undecided.z ? 1 : 2;
        vec2 c = first + way * vec2(k == 1, k == 2);
        vec3 point = corner.xyz + (right.xyz * c.x + up * c.y) / corner.w, inward = middle - point;
        point += inward * min(surface_offset / length(inward), 0.5);
        bool seen = bvh_free(p + surface_offset * g, point + surface_offset * g);
        vec3 alike = vec3(k == 0, k == 1, k == 2);
        if (hidden < HIDDEN_OTHERWISE && k != hidden) alike = 1.0 - vec3(hidden == 0, hidden == 1, hidden == 2);
        if (!seen) weights *= 1.0 - alike;
        if (seen && hidden < HIDDEN_OTHERWISE) weights *= alike;
        undecided *= seen && hidden < HIDDEN_OTHERWISE ? vec3(0.0) : 1.0 - alike;
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
