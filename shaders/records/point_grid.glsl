// Finding points by place in a grid of irrsplat/records/radius_limit_pass.py.
#include "lib/table.glsl"

uniform sampler2D grid_edges;   // texel i: the i-th plane across x, y and z
uniform sampler2D grid_starts;  // where each cell begins among the points, TABLE_COLUMNS a row
uniform sampler2D grid_points;  // cell by cell: xyz place, w number; TABLE_COLUMNS a row
uniform int grid_cells;         // along an axis

// A walk through the cells of a box, row by row along x: the points of a row lie one after the other.
struct Walk
{
    ivec3 first;  // cell
    ivec3 last;
    ivec2 row;    // y and z of the next row
    int next;     // number of the next point of this row
    int end;      // and of the first beyond it
};

// The cell of p along each axis, by bisection; beyond the grid it is the outermost one.
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

int grid_start(int cell)
{
    return int(texelFetch(grid_starts, table_texel(cell), 0).r);
}

// Starts a walk that finds all points in the box between two corners, and some beyond it.
Walk grid_walk(vec3 low, vec3 high)
{
    vec3 least = texelFetch(grid_edges, ivec2(0, 0), 0).xyz, greatest = texelFetch(grid_edges, ivec2(grid_cells, 0), 0).xyz;
    ivec3 first = grid_cell(low), last = grid_cell(high);
    bool apart = any(greaterThan(low, greatest)) || any(lessThan(high, least));
    return Walk(first, last, ivec2(first.y, apart ? grid_cells : first.z), 0, 0);
}

// Takes a step, to the next point (found) or else to the next row; returns false at the end of the walk.
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
