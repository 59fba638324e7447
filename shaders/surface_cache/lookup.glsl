// Lookup in the surface cache (METHOD.md, 11.1, 11.2): indirect irradiance on all surfaces, interpolated in the cells of
// irrsplat/surface_cache/tessellation.py.
#include "lib/rays/triangles.glsl"

uniform sampler2D surface_triangles;  // per triangle: n steps per edge, number of the first cell. For n² parts: -n, number of the first part;
                                      // for n strips across the edges at corner k: -n - (k + 1)/4
uniform sampler2D surface_cells;      // two texels per cell, front and back: xyz numbers of the values at the corners (-1: none); w: 0 if
                                      // all corners see each other; else an object occludes part of the cell, and w is the number
                                      // of the item with the lines beyond which corners are hidden
uniform sampler2D surface_values;     // rgb: E, W/m²; a: extent of the surface that a value represents, metres
uniform int surface_known;            // 1 if there are values; 0: all lookups use the first triangle

// Numbers and weights of three values. The weights sum to 1, or are all 0 if no corner has a value.
struct Lookup
{
    ivec3 values;
    vec3 weights;
};

// Return 1 for each corner of a cell that is visible from the point with these weights, else 0. item: the item of surface_cells
// with the lines, see _borders in site_layout.py.
vec3 surface_visible_corners(int item, vec3 weights)
{
    // factors on the weights of the next corner and of the one after it
    vec4 next = texel_at(surface_cells, table_texel(item, 2, 0));
    vec3 after = texel_at(surface_cells, table_texel(item, 2, 1)).xyz;
    vec3 along = weights.yzx * abs(next.xyz), across = weights.zxy * after;
    vec3 reach = mix(along + across, max(along, across), lessThan(next.xyz, vec3(0.0)));
    int single = int(next.w);  // the corner opposite to a visible pair; 3: none
    if (single < 3)
    {
        vec3 third = vec3(single == 0, single == 1, single == 2);
        return dot(reach, third) < 1.0 ? third : 1.0 - third;
    }
    float least = min(reach.x, min(reach.y, reach.z));  // without a visible corner, the corner with the nearest line
    return vec3(lessThanEqual(reach, vec3(max(least, 1.0))));
}

// Return the number of the cell with the point uv in a lattice of n rows, and the weights of its corners. uv: steps along the two
// edges from the first corner.
int surface_cell(vec2 uv, int n, out vec3 weights)
{
    int j = min(int(uv.y), n - 1), i = min(int(uv.x), n - 1 - j);
    vec2 f = uv - vec2(i, j);
    bool odd = f.x + f.y > 1.0 && i + j < n - 1;
    weights = max(odd ? vec3(f.x + f.y - 1.0, 1.0 - f) : vec3(1.0 - f.x - f.y, f), 0.0);
    return j * (2 * n - j) + 2 * i + int(odd);
}

// Return the number of the part with a point in a sliver of n strips, and the barycentric coordinates in this part. apex: the
// corner between the long edges.
int surface_strip(vec3 barycentric, int n, int apex, out vec3 inner)
{
    vec2 uv = float(n) * (apex == 0 ? barycentric.yz : apex == 1 ? barycentric.zx : barycentric.xy);
    int i = min(int(uv.x + uv.y), n - 1);
    float along = clamp(uv.x + uv.y - i, 0.0, 1.0), across = uv.y / (i + 1);
    bool odd = i > 0 && across > along;
    inner = odd ? vec3(uv.x / max(i, 1), along, 1.0 - uv.x / max(i, 1) - along) : vec3(1.0 - along, along - across, across);
    inner = max(inner, 0.0);
    return 2 * i - int(odd);
}

// Return the values of the cell at a point of a triangle. side: 0 for the front by the triangle's winding, 1 for the back.
Lookup surface_lookup(int triangle, vec3 barycentric, int side)
{
    vec2 lattice = texel_at(surface_triangles, table_texel(triangle * surface_known)).xy;
    vec3 weights;
    if (lattice.x < 0.0)
    {
        int n = int(-lattice.x), apex = int(4.0 * (-lattice.x - float(n))) - 1;
        int part = apex < 0 ? surface_cell(barycentric.yz * n, n, barycentric) : surface_strip(barycentric, n, apex, barycentric);
        lattice = texel_at(surface_triangles, table_texel(int(lattice.y) + part)).xy;
    }
    int cell = int(lattice.y) + surface_cell(barycentric.yz * lattice.x, int(lattice.x), weights);
    vec4 corners = texel_at(surface_cells, table_texel(cell, 2, side));
    vec3 valid = mix(weights, vec3(0.0), lessThan(corners.xyz, vec3(0.0)));
    if (corners.w > 0.0) valid *= surface_visible_corners(int(corners.w), weights);
    float sum = valid.x + valid.y + valid.z;
    return Lookup(ivec3(max(corners.xyz, 0.0)), sum > 0.0 ? valid / sum : vec3(0.0));
}

// Return the number of a value, drawn by weight with a random number in 0..1; -1 without a value.
int surface_drawn(Lookup lookup, float random)
{
    vec3 w = lookup.weights;
    int value = random < w.x ? lookup.values.x : random < w.x + w.y ? lookup.values.y : lookup.values.z;
    return w.x + w.y + w.z > 0.0 ? value : -1;
}

// Return the number of the value of greatest weight; -1 without a value.
int surface_nearest(Lookup lookup)
{
    vec3 w = lookup.weights;
    int value = w.x >= max(w.y, w.z) ? lookup.values.x : w.y >= w.z ? lookup.values.y : lookup.values.z;
    return w.x + w.y + w.z > 0.0 ? value : -1;
}

// Return value i of surface_values.
vec4 surface_value(int i)
{
    return texel_at(surface_values, table_texel(i));
}

// Return the indirect irradiance at a point of a triangle, W/m², and the extent of its values, metres. side: see surface_lookup.
vec4 surface_irradiance(int triangle, vec3 barycentric, int side)
{
    Lookup lookup = surface_lookup(triangle, barycentric, side);
    return lookup.weights.x * surface_value(lookup.values.x) + lookup.weights.y * surface_value(lookup.values.y) +
           lookup.weights.z * surface_value(lookup.values.z);
}

// Return irradiance and extent, as above, at the position p, on the side of the unit vector g.
vec4 surface_irradiance_at(int triangle, vec3 p, vec3 g)
{
    vec3 corner = triangle_point(triangle, 0), offset = p - corner;
    vec3 right = triangle_point(triangle, 1) - corner, up = triangle_point(triangle, 2) - corner, normal = cross(right, up);
    vec2 uv = clamp(vec2(dot(cross(offset, up), normal), dot(cross(right, offset), normal)) / dot(normal, normal), 0.0, 1.0);
    uv /= max(uv.x + uv.y, 1.0);
    return surface_irradiance(triangle, vec3(1.0 - uv.x - uv.y, uv), int(dot(normal, g) < 0.0));
}
