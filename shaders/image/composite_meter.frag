// The exposure meter: of a block of the image's pixels the sums of the log₂ luminances and of their squares, and how many are not
// black.
#include "generated/constants.glsl"
#include "lib/texel.glsl"

uniform sampler2D image;
uniform ivec2 block;  // width and height in pixels

layout(location = 0) out vec4 out_log;

void main()
{
    ivec2 corner = ivec2(gl_FragCoord.xy) * block, end = min(corner + block, textureSize(image, 0));
    out_log = vec4(0.0);
    for (int y = corner.y; y < end.y; ++y)
        for (int x = corner.x; x < end.x; ++x)
        {
            float Y = dot(texel_at(image, ivec2(x, y)).rgb, LUMINANCE);
            float stops = log2(max(Y, 1e-37));
            if (Y > 0.0) out_log += vec4(stops, stops * stops, 1.0, 0.0);
        }
}
