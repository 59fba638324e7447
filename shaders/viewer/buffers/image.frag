// The picture, exposed and tone-mapped, in front of a backdrop that emits no light.
#include "viewer/buffers/picture.glsl"

uniform sampler2D alpha;  // the share of a pixel that shows a surface
uniform bool plain;       // true if the picture already contains its background
uniform vec3 lower;       // display colours of the backdrop at the lower and the upper edge
uniform vec3 upper;
uniform float gain;       // the exposure as a factor

vec3 picture(ivec2 pixel, float depth)
{
    vec2 uv = gl_FragCoord.xy * scale / vec2(textureSize(values, 0));  // sampled with the texture's own filter
    vec3 radiance = textureLod(values, uv, 0.0).rgb;
    float share = plain ? 1.0 : textureLod(alpha, uv, 0.0).r;
    vec3 behind = mix(lower, upper, (float(pixel.y) + 0.5) / float(textureSize(values, 0).y));
    vec3 shown = display(radiance * (gain / max(share, 1e-6)));
    return share > 0.0 ? mix(behind, shown, share) : behind;
}
