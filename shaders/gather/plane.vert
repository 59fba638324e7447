// The paper's gather (Jones 2010, 2.1) for many records in one draw: instance i draws the scene on the plane of record i, into
// cell i of an atlas.
#include "generated/attributes.glsl"

in vec3 in_position;

uniform sampler2D frames;  // see Atlas.frames
uniform int columns;       // cells per row of the atlas
uniform float side;        // side of a cell, texels
uniform float extent;      // the tangent of half the field of view
uniform vec2 atlas;        // size of the atlas, texels
uniform float near;        // offset of the eye from its surface, metres

out float gl_ClipDistance[5];

flat out vec2 v_centre;  // centre of the cell, texels
flat out vec3 v_eye;     // world space, metres
flat out vec3 v_right;   // change of the direction (with normal component 1) from a texel to its right neighbour
flat out vec3 v_up;      // change to the upper neighbour
flat out vec3 v_ahead;   // direction at the centre of the cell: the normal

void main()
{
    vec3 tangent = texelFetch(frames, ivec2(gl_InstanceID, 0), 0).xyz;
    vec3 bitangent = texelFetch(frames, ivec2(gl_InstanceID, 1), 0).xyz;
    v_centre = (vec2(gl_InstanceID % columns, gl_InstanceID / columns) + 0.5) * side;
    v_eye = texelFetch(frames, ivec2(gl_InstanceID, 4), 0).xyz;
    v_right = tangent * (2.0 * extent / side);
    v_up = bitangent * (2.0 * extent / side);
    v_ahead = texelFetch(frames, ivec2(gl_InstanceID, 2), 0).xyz;
    pass_attributes();
    vec3 offset = in_position - v_eye;
    vec2 p = vec2(dot(tangent, offset), dot(bitangent, offset)) / extent;
    float w = dot(v_ahead, offset);
    // four sides and the apex of the pyramid; depth clamp replaces the near and the far plane
    gl_ClipDistance[0] = w - p.x;
    gl_ClipDistance[1] = w + p.x;
    gl_ClipDistance[2] = w - p.y;
    gl_ClipDistance[3] = w + p.y;
    gl_ClipDistance[4] = w - 0.05 * near;
    gl_Position = vec4((2.0 * v_centre / atlas - 1.0) * w + side / atlas * p, w - 2.0 * near, w);
}
