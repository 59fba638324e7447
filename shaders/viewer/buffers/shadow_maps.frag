// A tile of the shadow maps: how far along its axis lies what the light sees there.
#include "viewer/colours.glsl"

uniform sampler2D shadow_depth;
uniform vec2 corner;    // first texel of the tile
uniform vec3 place;     // of the tile in the target: its lower left corner, and texels per pixel
uniform float thickness;  // metres of depth in the tile
uniform float low;      // metres
uniform float high;

layout(location = 0) out vec4 out_color;

void main()
{
    float stored = texelFetch(shadow_depth, ivec2(corner + (gl_FragCoord.xy - place.xy) * place.z), 0).r;
    float z = stored * thickness;
    out_color = vec4(stored < 1.0 ? heat((z - low) / (high - low)) : vec3(0.0), 1.0);
}
