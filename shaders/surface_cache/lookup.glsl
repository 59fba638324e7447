// The surface cache: indirect irradiance at sites spread over all surfaces, by the cells of tessellation.py.
#include "lib/rays/triangles.glsl"

uniform sampler2D surface_triangles;  // a texel a triangle: its steps n, and the number of its first cell; of parts, -n and the texel of the
                                      // first; -n - (k + 1)/4 for strips across the edges at corner k
uniform sampler2D surface_cells;      // two texels a cell, one for each side: xyz the numbers of its corners' values (-1: none);
                                      // w 0 where the corners see each other; positive: an object occludes part of the cell, and w is
                                      // the number of the item with the lines beyond which corners are hidden
uniform sampler2D surface_values;     // rgb E in W/m²; a: extent in metres of the surface that a value represents
uniform int surface_known;            // 0: no value is known yet, and the first triangle represents all

// Three values and their weights at a place, which sum to 1, or are all 0 where no value is known.
struct Lookup
{
    ivec3 values;
    vec3 weights;
};

// 1 for each corner of a cell that is visible from the point with these weights. `item`: the row of surface_cells with the lines
// that bound visibility, see _borders in site_layout.py.
vec3 surface_corners_seen(int item, vec3 weights)
{
    vec4 next = texel_at(surface_cells, table_texel(item, 2, 0));
    vec3 after = texel_at(surface_cells, table_texel(item, 2, 1)).xyz;
    vec3 along = weights.yzx * abs(next.xyz), across = weights.zxy * after;
    vec3 reach = mix(along + across, max(along, across), lessThan(next.xyz, vec3(0.0)));
    int alone = int(next.w);
    if (alone < 3)
    {
        vec3 third = vec3(alone == 0, alone == 1, alone == 2);
        return dot(reach, third) < 1.0 ? third : 1.0 - third;
    }
    float least = min(reach.x, min(reach.y, reach.z));  // a place without a visible corner takes the nearest to visible
    return vec3(lessThanEqual(reach, vec3(max(least, 1.0))));
}

// The cell of n rows in which a place lies, by its coordinates uv in steps along the edges from the first corner; and its weights.
int surface_cell(vec2 uv, int n, out vec3 share)
{
    int j = min(int(uv.y), n - 1), i = min(int(uv.x), n - 1 - j);
    vec2 f = uv - vec2(i, j);
    bool odd = f.x + f.y > 1.0 && i + j < n - 1;
    share = max(odd ? vec3(f.x + f.y - 1.0, 1.0 - f) : vec3(1.0 - f.x - f.y, f), 0.0);
    return j * (2 * n - j) + 2 * i + int(odd);
}

// The part of a sliver of n strips in which a place with these barycentric coordinates lies, and its coordinates in the part.
// apex: the corner between the long edges.
int surface_strip(vec3 share, int n, int apex, out vec3 within)
{
    vec2 uv = float(n) * (apex == 0 ? share.yz : apex == 1 ? share.zx : share.xy);
    int i = min(int(uv.x + uv.y), n - 1);
    float along = clamp(uv.x + uv.y - i, 0.0, 1.0), across = uv.y / (i + 1);
    bool odd = i > 0 && across > along;
    within = odd ? vec3(uv.x / max(i, 1), along, 1.0 - uv.x / max(i, 1) - along) : vec3(1.0 - along, along - across, across);
    within = max(within, 0.0);
    return 2 * i - int(odd);
}

// The values at the corners of the cell at a point of the triangle with these barycentric coordinates; side: 0 for the front
// by the triangle's winding, 1 for the back.
Lookup surface_lookup(int triangle, vec3 share, int side)
{
    vec2 cut = texel_at(surface_triangles, table_texel(triangle * surface_known)).xy;
    vec3 weights;
    if (cut.x < 0.0)
    {
        int n = int(-cut.x), apex = int(4.0 * (-cut.x - float(n))) - 1;
        int part = apex < 0 ? surface_cell(share.yz * n, n, share) : surface_strip(share, n, apex, share);
        cut = texel_at(surface_triangles, table_texel(int(cut.y) + part)).xy;
    }
    int cell = int(cut.y) + surface_cell(share.yz * cut.x, int(cut.x), weights);
    vec4 found = texel_at(surface_cells, table_texel(cell, 2, side));
    vec3 known = mix(weights, vec3(0.0), lessThan(found.xyz, vec3(0.0)));
    if (found.w > 0.0) known *= surface_corners_seen(int(found.w), weights);
    float sum = known.x + known.y + known.z;
    return Lookup(ivec3(max(found.xyz, 0.0)), sum > 0.0 ? known / sum : vec3(0.0));
}

// The number of one of the values, drawn by its weight by a number in 0..1; -1 where no value is known.
int surface_drawn(Lookup lookup, float random)
{
    vec3 w = lookup.weights;
    int value = random < w.x ? lookup.values.x : random < w.x + w.y ? lookup.values.y : lookup.values.z;
    return w.x + w.y + w.z > 0.0 ? value : -1;
}

// The number of the value of the greatest weight; -1 where no value is known.
int surface_nearest(Lookup lookup)
{
    vec3 w = lookup.weights;
    int value = w.x >= max(w.y, w.z) ? lookup.values.x : w.y >= w.z ? lookup.values.y : lookup.values.z;
    return w.x + w.y + w.z > 0.0 ? value : -1;
}

vec4 surface_value(int i)
{
    return texel_at(surface_values, table_texel(i));
}

// Indirect irradiance at such a point, W/m², and the extent of its values in metres.
vec4 surface_irradiance(int triangle, vec3 share, int side)
{
    Lookup lookup = surface_lookup(triangle, share, side);
    return lookup.weights.x * surface_value(lookup.values.x) + lookup.weights.y * surface_value(lookup.values.y) +
           lookup.weights.z * surface_value(lookup.values.z);
}

// The same at a point p of the triangle, on the side to which the unit vector g points.
vec4 surface_irradiance_at(int triangle, vec3 p, vec3 g)
{
    vec3 corner = triangle_point(triangle, 0), away = p - corner;
    vec3 right = triangle_point(triangle, 1) - corner, up = triangle_point(triangle, 2) - corner, normal = cross(right, up);
    vec2 uv = clamp(vec2(dot(cross(away, up), normal), dot(cross(right, away), normal)) / dot(normal, normal), 0.0, 1.0);
    uv /= max(uv.x + uv.y, 1.0);
    return surface_irradiance(triangle, vec3(1.0 - uv.x - uv.y, uv), int(dot(normal, g) < 0.0));
}
