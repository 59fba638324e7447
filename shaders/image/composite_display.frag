// The image on a display (METHOD.md, 10.2): exposed, tone-mapped, sRGB-encoded, and dithered to eight bits.
#include "lib/display.glsl"
#include "lib/dither.glsl"
#include "lib/texel.glsl"

uniform sampler2D image;  // linear radiance
uniform float exposure;  // stops

layout(location = 0) out vec4 out_color;

void main()
{
    vec3 shown = display(texel_at(image, ivec2(gl_FragCoord.xy)).rgb * exp2(exposure));
    out_color = vec4(shown + (dither(gl_FragCoord.xy) - 0.5) / 255.0, 1.0);  // OpenGL rounds to the nearest of 256 values
}
