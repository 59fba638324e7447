// FLIP's map 0..1 in the colours of numbers.
#include "viewer/colours.glsl"

uniform sampler2D map;
uniform vec2 size;  // of the target, pixels

layout(location = 0) out vec4 out_color;

void main()
{
    out_color = vec4(heat(texelFetch(map, ivec2(gl_FragCoord.xy * vec2(textureSize(map, 0)) / size), 0).r), 1.0);
}
