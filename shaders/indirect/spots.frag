// One pixel of each square of a view: position and cached irradiance, for comparison with a probe there.
#include "generated/constants.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform sampler2D albedo;
uniform sampler2D emission;
uniform sampler2D sums;      // Σ k·E, Σ k, of every pixel
uniform int stride;          // pixels along a side of the squares; each square has one probed pixel
uniform ivec2 corner;        // of the drawn part, in pixels of the whole picture
uniform ivec2 first;         // the first square

layout(location = 0) out vec4 out_position;  // w: 1 where records contribute, and the surface reflects more than it emits
layout(location = 1) out vec4 out_normal;    // its shading normal, geometric normal octahedral .x
layout(location = 2) out vec4 out_rest;      // geometric normal octahedral .y, luminance of E in W/m², triangle, 0

void main()
{
    ivec2 pixel = pixel_of_square(first + ivec2(gl_FragCoord.xy), stride) - corner;
    out_position = out_normal = out_rest = vec4(0.0);
    if (pixel != clamp(pixel, ivec2(0), textureSize(position, 0) - 1)) return;
    vec4 p = texel_at(position, pixel), a = texel_at(albedo, pixel), e = texel_at(emission, pixel), s = texel_at(sums, pixel);
    float cached = s.a > 0.0 ? dot(s.rgb, LUMINANCE) / s.a : 0.0;
    bool requested = p.w > 0.0 && s.a > 0.0 && dot(e.rgb, LUMINANCE) * PI <= dot(a.rgb, LUMINANCE) * cached;
    out_position = vec4(p.xyz, requested ? 1.0 : 0.0);
    out_normal = texel_at(normal, pixel);
    out_rest = vec4(a.w, cached, e.w, 0.0);
}
