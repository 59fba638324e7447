// Direct light at every pixel, with four dithered shadow samples per light (Jones 2010, sections 2.4 and 3.3).
#include "generated/gbuffer_material.glsl"
#include "lib/texel.glsl"
#include "lighting/lights.glsl"
#include "lib/material.glsl"
#include "lib/octahedral.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
#if NORMAL_MAPS
uniform sampler2D lit_normal;  // bent by the normal map
#endif
uniform ivec2 picture_corner; // the pixel of the whole picture that is the first one here
uniform float rotation;      // of the pattern of the four samples, radians
uniform vec4 headlamp;       // where it is, and its W/sr

const float SMOOTH = 0.99999;  // cosine of the angle between geometric and interpolated normal, below which facets stand for a curve

layout(location = 0) out vec4 out_direct;  // outgoing radiance ρ/π·E, or with IRRADIANCE E itself; a: 1 where a surface is seen

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(position, pixel), n = texel_at(normal, pixel);
    out_direct = vec4(0.0);
    if (p.w == 0.0) return;
    // interleaved gradient noise (Jimenez 2014) rotates the pattern from pixel to pixel
    float angle = 2.0 * PI * fract(52.9829189 * fract(dot(gl_FragCoord.xy + vec2(picture_corner), vec2(0.06711056, 0.00583715)))) + rotation;
    vec3 m = n.xyz;
#if NORMAL_MAPS
    m = texel_at(lit_normal, pixel).xyz;
#endif
    vec3 g = octahedral_decode(vec2(n.w, texel_at(albedo, pixel).w));
    Receiver receiver = Receiver(p.xyz, m, g, dot(n.xyz, g) < SMOOTH ? CURVED : FLAT);
    vec3 E = direct_irradiance(receiver, 4, vec2(cos(angle), sin(angle)));
    if (headlamp.w > 0.0)  // it is where the eye is, and casts no shadow that could be seen
    {
        vec3 l = headlamp.xyz - p.xyz;
        E += headlamp.w * max(dot(receiver.n, normalize(l)), 0.0) / max(dot(l, l), 1e-20);
    }
#ifdef IRRADIANCE
    out_direct = vec4(E, 1.0);
#else
    out_direct = vec4(reflected_radiance(material_at(pixel), E), 1.0);
#endif
}
