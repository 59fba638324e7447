// Baking: splats a record on a tile of points that do not form an image of the scene, such as texels of a lightmap. An instance
// is a record and a tile that it may cover. The fragment shader is indirect/splat.frag.
#include "indirect/splat_outputs.glsl"

uniform sampler2D pairs;     // by instance: x record, yz first texel of the tile
uniform vec2 texels;         // width and height of the texture of points
uniform float tile;          // texels along a side of a tile

void main()
{
    vec4 pair = texelFetch(pairs, table_texel(gl_InstanceID), 0);
    ivec2 texel = table_texel(int(pair.x));
    float trust;
    Ellipse ellipse = view_ellipse(texel, 1.0, trust);  // distance 1: the bounds are equal for all points
    pass_record(texel, ellipse, trust);
    vec2 corner = pair.yz + tile * vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = vec4(2.0 * corner / texels - 1.0, 0.0, 1.0);
}
