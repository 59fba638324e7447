// The interface: window coordinates, from the top left corner down, to the whole target.
in vec2 in_position;
in vec2 in_uv;
in vec4 in_color;

uniform vec4 window;  // its top left corner, its width and height, in window coordinates

out vec2 v_uv;
out vec4 v_color;

void main()
{
    vec2 place = 2.0 * (in_position - window.xy) / window.zw - 1.0;
    gl_Position = vec4(place.x, -place.y, 0.0, 1.0);
    v_uv = in_uv;
    v_color = in_color;
}
