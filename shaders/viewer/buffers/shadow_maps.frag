// Shadow maps: the distance from the light to the first surface along the map's axis, as a share of the map's depth.
#include "viewer/tiles.glsl"
#include "viewer/colours.glsl"

uniform sampler2D shadow_depth;

layout(location = 0) out vec4 out_color;

void main()
{
    ivec2 texel;
    int i = tile_at(texel);
    float stored = i < 0 ? 1.0 : texelFetch(shadow_depth, corner_of(i) + texel, 0).r;
    out_color = vec4(i < 0 ? ground : stored < 1.0 ? heat(stored) : vec3(0.0), 1.0);
}
