// The picture of a view of which every other pixel is splatted, in one draw: direct light, what upsampling says of indirect light, and
// their sum. The pixels that upsampling has to search for are marked in the depth buffer, for picture_search.frag.
#include "lighting/direct_light.glsl"
#include "upsample/between.glsl"
#if SKY
#include "image/backdrop.glsl"
#endif
#include "lib/material.glsl"

// EMISSIVE, SKY: as in image/composite.frag.

uniform sampler2D position;  // g-buffer
uniform vec2 blend;          // weights of direct and indirect light

layout(location = 0) out vec4 out_image;
layout(location = 1) out float out_alpha;  // 1 where a surface is seen

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(position, at);
    bool between, none, seen = p.w > 0.0;
    vec3 E = between_four(at, p, between, none).rgb;
    Material material = material_at(at);
    vec3 light = blend.x * reflected_radiance(material, direct_irradiance_at(at, p.xyz)) + blend.y * reflected_radiance(material, E);
#if EMISSIVE
    light += material.emission;
#endif
    vec3 behind = vec3(0.0);
#if SKY == 1
    behind = sky;
#elif SKY
    behind = sky_behind(gl_FragCoord.xy);
#endif
    out_image = vec4(seen ? light : behind, 1.0);
    out_alpha = seen ? 1.0 : 0.0;
    gl_FragDepth = between || none || !seen ? 0.0 : 1.0;
}
