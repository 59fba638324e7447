// The exposure meter: the sum of the log₂ luminances of a block of the image's pixels, and the number of those that are not black.
#include "generated/constants.glsl"

uniform sampler2D image;
uniform ivec2 block;  // width and height in pixels

layout(location = 0) out vec2 out_log;

void main()
{
    ivec2 corner = ivec2(gl_FragCoord.xy) * block, end = min(corner + block, textureSize(image, 0));
    out_log = vec2(0.0);
    for (int y = corner.y; y < end.y; ++y)
        for (int x = corner.x; x < end.x; ++x)
        {
            float Y = dot(texelFetch(image, ivec2(x, y), 0).rgb, LUMINANCE);
            if (Y > 0.0) out_log += vec2(log2(Y), 1.0);
        }
}
