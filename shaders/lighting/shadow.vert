// The scene as one light's tile sees it: depth alone.
in vec3 in_position;

uniform vec4 tile_right;    // rows of tile from world, dotted with (p, 1)
uniform vec4 tile_up;
uniform vec4 tile_forward;
uniform float tile_near;    // metres; 0 for a parallel tile, whose depth is already 0..1

void main()
{
    vec4 p = vec4(in_position, 1.0);
    vec3 q = vec3(dot(tile_right, p), dot(tile_up, p), dot(tile_forward, p));
    // perspective: depth = 1 - near/z, no far plane
    gl_Position = tile_near > 0.0 ? vec4(q.xy, q.z - 2.0 * tile_near, q.z) : vec4(q.xy, 2.0 * q.z - 1.0, 1.0);
}
