// Search for nearby points in a grid, made by irrsplat/records/radius_limit_pass.py.
#include "lib/table.glsl"

uniform sampler2D grid_edges;   // texel i: coordinates of the i-th grid plane across x, y and z, metres
uniform sampler2D grid_starts;  // number of the first point of each cell, TABLE_COLUMNS cells per row
uniform sampler2D grid_points;  // points cell by cell: xyz position, metres; w number; TABLE_COLUMNS points per row
uniform int grid_cells;         // cells along each axis

// A walk through the cells of a box, row by row along x. The points of a row are consecutive.
struct Walk
{
    ivec3 first;  // first cell
    ivec3 last;   // last cell
    ivec2 row;    // y and z of the next row
    int next;     // number of the next point of this row
    int end;      // number of the first point after this row
};

// Return the cell of p along each axis, by bisection; the outermost cell for a point outside of the grid.
ivec3 grid_cell(vec3 p)
{
    vec3 low = vec3(0.0), high = vec3(grid_cells - 1);
    for (int size = grid_cells; size > 0; size /= 2)
    {
        vec3 middle = floor((low + high + 1.0) / 2.0);
        ivec3 i = ivec3(middle);
        vec3 edge = vec3(texelFetch(grid_edges, ivec2(i.x, 0), 0).x, texelFetch(grid_edges, ivec2(i.y, 0), 0).y,
                         texelFetch(grid_edges, ivec2(i.z, 0), 0).z);
        bvec3 reached = lessThanEqual(edge, p);
        high = mix(middle - 1.0, high, reached);
        low = mix(low, middle, reached);
    }
    return ivec3(low);
}

// Return the number of the first point of a cell.
int grid_start(int cell)
{
    return int(texelFetch(grid_starts, table_texel(cell), 0).r);
}

// Return a walk that finds all points in the box between two corners, and some points outside of the box.
Walk grid_walk(vec3 low, vec3 high)
{
    vec3 least = texelFetch(grid_edges, ivec2(0, 0), 0).xyz, greatest = texelFetch(grid_edges, ivec2(grid_cells, 0), 0).xyz;
    ivec3 first = grid_cell(low), last = grid_cell(high);
    bool disjoint = any(greaterThan(low, greatest)) || any(lessThan(high, least));
    return Walk(first, last, ivec2(first.y, disjoint ? grid_cells : first.z), 0, 0);
}

// Advance a walk to the next point (found is true) or to the next row (found is false). Return false at the end of the walk.
bool grid_step(inout Walk walk, out bool found, out vec4 point)
{
    found = walk.next < walk.end;
    point = texelFetch(grid_points, table_texel(walk.next), 0);
    if (found)
    {
        ++walk.next;
        return true;
    }
    if (walk.row.y > walk.last.z) return false;
    int row = (walk.row.y * grid_cells + walk.row.x) * grid_cells;
    walk.next = grid_start(row + walk.first.x);
    walk.end = grid_start(row + walk.last.x + 1);
    walk.row = walk.row.x < walk.last.y ? walk.row + ivec2(1, 0) : ivec2(walk.first.y, walk.row.y + 1);
    return true;
}
