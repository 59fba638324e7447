// The scene as many records see it at once: an instance is the plane of one record, drawn into its own cell of an atlas.
#include "generated/attributes.glsl"

in vec3 in_position;

uniform sampler2D frames;  // as Atlas.frames
uniform int columns;       // of cells
uniform float side;        // of a cell, texels
uniform float extent;      // the tangent of half the field of view
uniform vec2 atlas;        // texels
uniform float near;        // metres

out float gl_ClipDistance[5];

flat out vec2 v_centre;  // of the cell, texels
flat out vec3 v_eye;
flat out vec3 v_right;   // the step of the direction whose normal part is 1, from a texel to its right neighbour
flat out vec3 v_up;
flat out vec3 v_ahead;   // that direction at the cell's centre

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
    vec3 away = in_position - v_eye;
    vec2 p = vec2(dot(tangent, away), dot(bitangent, away)) / extent;
    float w = dot(v_ahead, away);
    // the four sides of the plane, and its tip; there is no near plane beyond that (depth clamp), and no far one
    gl_ClipDistance[0] = w - p.x;
    gl_ClipDistance[1] = w + p.x;
    gl_ClipDistance[2] = w - p.y;
    gl_ClipDistance[3] = w + p.y;
    gl_ClipDistance[4] = w - 0.05 * near;
    gl_Position = vec4((2.0 * v_centre / atlas - 1.0) * w + side / atlas * p, w - 2.0 * near, w);
}
