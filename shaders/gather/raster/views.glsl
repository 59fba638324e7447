// What records look through: the faces of their hemicubes, or the paper's one plane.
#include "generated/constants.glsl"

uniform sampler2D views;  // texel (i, VIEW_ROWS·f + k) is row k of face f of record i

const int VIEW_X = 0;      // rows of face from world, dotted with (p, 1): the face is |x|, |y| <= w
const int VIEW_Y = 1;
const int VIEW_W = 2;
const int VIEW_CELL = 3;   // centre and half size in the atlas, texels
const int VIEW_EYE = 4;    // xyz where the record looks from
const int VIEW_RIGHT = 5;  // xyz what a texel to the right, and one up, add to the direction whose w is 1
const int VIEW_UP = 6;
const int VIEW_AHEAD = 7;  // xyz that direction at the cell's centre

vec4 view_row(ivec2 record_and_face, int row)
{
    return texelFetch(views, record_and_face * ivec2(1, VIEW_ROWS) + ivec2(0, row), 0);
}

#if !MESHLETS
flat out vec2 v_centre;  // as gather/raster/texel.glsl takes them
flat out vec3 v_eye;
flat out vec3 v_right;
flat out vec3 v_up;
flat out vec3 v_ahead;

void view_of_texels(ivec2 at)
{
    v_centre = view_row(at, VIEW_CELL).xy;
    v_eye = view_row(at, VIEW_EYE).xyz;
    v_right = view_row(at, VIEW_RIGHT).xyz;
    v_up = view_row(at, VIEW_UP).xyz;
    v_ahead = view_row(at, VIEW_AHEAD).xyz;
}
#endif
