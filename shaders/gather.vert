// The scene as many records see it at once: an instance is one face of one record, drawn into its own cell of an atlas.
in vec3 in_position;
in vec3 in_normal;
in vec3 in_albedo;
in vec3 in_emission;

in vec4 face_x;     // rows of face from world, dotted with (p, 1): the face is |x|, |y| <= w
in vec4 face_y;
in vec4 face_w;
in vec4 face_cell;  // centre and half size in the atlas, normalised device coordinates
in vec3 face_eye;   // where the record looks from

uniform float near; // metres

out vec3 v_position;
out vec3 v_normal;
out vec3 v_albedo;
out vec3 v_emission;
flat out vec3 v_eye;
out float gl_ClipDistance[5];

void main()
{
    vec4 p = vec4(in_position, 1.0);
    float x = dot(face_x, p), y = dot(face_y, p), w = dot(face_w, p);
    // the four sides of the face; there is no near plane (depth clamp) and no far one
    gl_ClipDistance[0] = w - x;
    gl_ClipDistance[1] = w + x;
    gl_ClipDistance[2] = w - y;
    gl_ClipDistance[3] = w + y;
    gl_ClipDistance[4] = w - 0.05 * near;
    gl_Position = vec4(face_cell.xy * w + face_cell.zw * vec2(x, y), w - 2.0 * near, w);
    v_position = in_position;
    v_normal = in_normal;
    v_albedo = in_albedo;
    v_emission = in_emission;
    v_eye = face_eye;
}
