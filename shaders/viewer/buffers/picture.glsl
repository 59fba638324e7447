// Shared code of all buffers of the view. A fragment shader includes it and defines picture(), the display colour of a pixel.
#include "generated/constants.glsl"
#include "lib/display.glsl"
#include "viewer/colours.glsl"

uniform sampler2D position;  // g-buffer; w depth along the view axis, 0 without a surface
uniform sampler2D values;    // the values of the buffer
uniform vec2 scale;          // pixels of the view per pixel of the target

layout(location = 0) out vec4 out_color;

vec3 picture(ivec2 pixel, float depth);

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy * scale);
    out_color = vec4(picture(pixel, texelFetch(position, pixel, 0).w), 1.0);
}
