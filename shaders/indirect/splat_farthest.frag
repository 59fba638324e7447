// The distance of the farthest surface in each tile of the screen: what lies farther from the eye is hidden there.
#include "lib/texel.glsl"

uniform sampler2D position;  // g-buffer
uniform vec3 eye;
uniform int pixel_stride;    // 1, or 2 where only every other pixel counts, in x and y

// TILE, from irrsplat/records/culling.py: pixels along a side of a tile

layout(location = 0) out float out_distance;  // metres, 0 where nothing is seen

void main()
{
    ivec2 corner = ivec2(gl_FragCoord.xy) * TILE, size = textureSize(position, 0);
    int side = TILE / pixel_stride;
    float farthest = 0.0;
    for (int i = 0; i < side * side; ++i)
    {
        ivec2 pixel = min(corner + pixel_stride * texel_of_square(i, side), size - 1);
        vec4 p = texel_at(position, pixel);
        farthest = p.w > 0.0 ? max(farthest, length(p.xyz - eye)) : farthest;
    }
    out_distance = farthest;
}
