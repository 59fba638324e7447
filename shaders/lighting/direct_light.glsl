// Direct irradiance at a pixel of a view, with four dithered shadow samples per light (Jones 2010, sections 2.4 and 3.3).
#include "generated/gbuffer_material.glsl"
#include "lib/octahedral.glsl"
#include "lib/texel.glsl"
#include "lighting/lights.glsl"
#include "lighting/picture_corner.glsl"

// NORMAL_MAPS: 1 where normals are bent by normal maps.

uniform sampler2D normal;     // g-buffer
#if NORMAL_MAPS
uniform sampler2D lit_normal;  // bent by the normal map
#endif
uniform float rotation;        // of the pattern of the four samples, radians
uniform vec4 headlamp;         // where it is, and its W/sr

// W/m² at a pixel that sees the place p.
vec3 direct_irradiance_at(ivec2 pixel, vec3 p)
{
    // interleaved gradient noise (Jimenez 2014) rotates the pattern from pixel to pixel
    float angle = 2.0 * PI * fract(52.9829189 * fract(dot(gl_FragCoord.xy + vec2(picture_corner), vec2(0.06711056, 0.00583715)))) + rotation;
    vec4 n = texel_at(normal, pixel);
    vec3 m = n.xyz;
#if NORMAL_MAPS
    m = texel_at(lit_normal, pixel).xyz;
#endif
    Receiver receiver = Receiver(p, m, octahedral_decode(vec2(n.w, texel_at(albedo, pixel).w)));
    vec3 E = direct_irradiance(receiver, 4, vec2(cos(angle), sin(angle)));
    if (headlamp.w > 0.0)  // it is where the eye is, and casts no shadow that could be seen
    {
        vec3 l = headlamp.xyz - p;
        E += headlamp.w * max(dot(receiver.n, normalize(l)), 0.0) / max(dot(l, l), 1e-20);
    }
    return E;
}
