// The picture of a view of which every other pixel is splatted, second draw: the indirect light of the marked pixels, to be added.
#include "generated/gbuffer_material.glsl"
#include "lib/material.glsl"
#include "upsample/search.glsl"

uniform vec2 blend;  // weights of direct and indirect light

layout(location = 0) out vec4 out_image;
layout(location = 1) out float out_alpha;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    out_image = vec4(blend.y * reflected_radiance(material_at(pixel), searched(pixel).rgb), 0.0);
    out_alpha = 0.0;
}
