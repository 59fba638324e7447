// The scene as many records see it at once: an instance is one face of one record, drawn into its own cell of an atlas.
in vec3 in_position;
in vec3 in_normal;
in vec3 in_albedo;
in vec3 in_emission;

in vec4 face_x;      // rows of face from world, dotted with (p, 1): the face is |x|, |y| <= w
in vec4 face_y;
in vec4 face_w;
in vec4 face_cell;   // centre and half size in the atlas, texels
in vec3 face_eye;    // where the record looks from
in vec3 face_right;  // what a texel to the right, and one up, add to the direction whose w is 1
in vec3 face_up;
in vec3 face_ahead;  // that direction at the cell's centre

uniform vec2 atlas;  // texels
uniform float near;  // metres

out vec3 v_normal;
out vec3 v_albedo;
out vec3 v_emission;
flat out vec2 v_centre;
flat out vec3 v_eye;
flat out vec3 v_right;
flat out vec3 v_up;
flat out vec3 v_ahead;
out float gl_ClipDistance[5];

void main()
{
    vec4 p = vec4(in_position, 1.0);
    float x = dot(face_x, p), y = dot(face_y, p), w = dot(face_w, p);
    // the four sides of the face, and its tip; there is no near plane beyond that (depth clamp), and no far one
    gl_ClipDistance[0] = w - x;
    gl_ClipDistance[1] = w + x;
    gl_ClipDistance[2] = w - y;
    gl_ClipDistance[3] = w + y;
    gl_ClipDistance[4] = w - 0.05 * near;
    vec4 cell = face_cell * 2.0 / atlas.xyxy;
    gl_Position = vec4((cell.xy - 1.0) * w + cell.zw * vec2(x, y), w - 2.0 * near, w);
    v_normal = in_normal;
    v_albedo = in_albedo;
    v_emission = in_emission;
    v_centre = face_cell.xy;
    v_eye = face_eye;
    v_right = face_right;
    v_up = face_up;
    v_ahead = face_ahead;
}
