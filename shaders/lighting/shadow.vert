// The scene as one tile of a light's shadow map sees it; only depth is drawn.
#if CUT_OUTS
#include "generated/attributes.glsl"
#endif

in vec3 in_position;

uniform vec4 tile_right;    // rows of tile from world, dotted with (p, 1)
uniform vec4 tile_up;
uniform vec4 tile_forward;
uniform float tile_near;    // distance of the near plane, metres; 0 for a parallel tile, whose depth is 0..1 already

void main()
{
#if CUT_OUTS
    pass_attributes();
#endif
    vec4 p = vec4(in_position, 1.0);
    vec3 q = vec3(dot(tile_right, p), dot(tile_up, p), dot(tile_forward, p));
    // perspective: the near plane clips, and the fragments have their own depth
    gl_Position = tile_near > 0.0 ? vec4(q.xy, q.z - 2.0 * tile_near, q.z) : vec4(q.xy, 2.0 * q.z - 1.0, 1.0);
}
