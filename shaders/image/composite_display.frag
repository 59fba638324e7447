// The image as a screen shows it: exposed, through the filmic curve, sRGB-encoded.
#include "lib/display.glsl"
#include "lib/texel.glsl"

uniform sampler2D image;
uniform float exposure;  // stops

layout(location = 0) out vec4 out_color;

void main()
{
    out_color = vec4(display(texel_at(image, ivec2(gl_FragCoord.xy)).rgb * exp2(exposure)), 1.0);
}
