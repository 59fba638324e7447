// A record on a tile of places that do not lie as on a screen, such as the texels of a lightmap; an instance is a record and a tile
// that it may reach. The fragments are those of indirect/splat.frag.
#include "indirect/splat_outputs.glsl"

uniform sampler2D pairs;     // by number: x record, yz the tile's first texel
uniform vec2 texels;         // width and height of the places
uniform float tile;          // texels along a side of a tile

void main()
{
    vec4 pair = texelFetch(pairs, table_texel(gl_InstanceID), 0);
    ivec2 texel = table_texel(int(pair.x));
    float trust;
    Ellipse ellipse = view_ellipse(texel, 1.0, trust);  // from everywhere as from a metre away: the bounds are the same for all
    pass_record(texel, ellipse, trust);
    vec2 corner = pair.yz + tile * vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = vec4(2.0 * corner / texels - 1.0, 0.0, 1.0);
}
