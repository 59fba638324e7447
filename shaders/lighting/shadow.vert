// A tile of a light's shadow map (Jones 2010, 3.3; METHOD.md, 9.2): draws the depth of the scene.
#if CUT_OUTS
#include "generated/attributes.glsl"
#endif

in vec3 in_position;

uniform vec4 tile_right;    // rows of the matrix from world space to the tile
uniform vec4 tile_up;
uniform vec4 tile_forward;
uniform float tile_near;    // distance of the near plane, metres; 0 for a parallel tile, which has depths 0..1

void main()
{
#if CUT_OUTS
    pass_attributes();
#endif
    vec4 p = vec4(in_position, 1.0);
    vec3 q = vec3(dot(tile_right, p), dot(tile_up, p), dot(tile_forward, p));
    // in a perspective tile, the near plane clips, and shadow.frag computes the depth
    gl_Position = tile_near > 0.0 ? vec4(q.xy, q.z - 2.0 * tile_near, q.z) : vec4(q.xy, 2.0 * q.z - 1.0, 1.0);
}
