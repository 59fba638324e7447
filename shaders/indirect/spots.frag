// One pixel of each square of a view: position and cached irradiance, for comparison with a probe there.
#include "generated/constants.glsl"
#include "lib/gbuffer.glsl"

uniform sampler2D sums;      // Σ k·E, Σ k, of every pixel
uniform float pixel_size;    // metres between pixels at distance 1
uniform int stride;          // pixels along a side of the squares; each square has one probed pixel
uniform ivec2 corner;        // of the drawn part, in pixels of the whole picture
uniform ivec2 whole;         // size of the whole picture in pixels
uniform ivec2 first;         // the first square

layout(location = 0) out vec4 out_position;  // w: 1 where records contribute, and the surface reflects more than it emits
layout(location = 1) out vec4 out_normal;    // its shading normal, geometric normal octahedral .x
layout(location = 2) out vec4 out_rest;      // geometric normal octahedral .y, luminance of E in W/m², triangle; 1 at a crease

const float STEEP = 0.2;      // least sine of the angle between a plane and the way to a surface that rises above it
const float FAR = 8.0;        // pixel distances per pixel: greatest distance to a surface that counts

// 1 where a surface rises above the plane at p with normal n within MARGIN pixels. At the foot of a ledge, light changes within the
// height of the ledge, and records all around agree.
float at_crease(ivec2 pixel, vec3 p, vec3 n)
{
    float found = 0.0;
    for (int i = 0; i < 4 * MARGIN; ++i)
    {
        int pixels = 1 + i / 4;
        ivec2 step = (i & 2) == 0 ? ivec2(pixels, 0) : ivec2(0, pixels);
        ivec2 at = pixel + ((i & 1) == 0 ? step : -step);
        if (at + corner != clamp(at + corner, ivec2(0), whole - 1)) continue;
        vec4 other = texel_at(position, clamp(at, ivec2(0), textureSize(position, 0) - 1));
        vec3 way = other.xyz - p;
        float d = length(way);
        if (other.w > 0.0 && dot(way, n) > STEEP * d && d < FAR * pixel_size * other.w * float(pixels)) found = 1.0;
    }
    return found;
}

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
    out_rest = vec4(a.w, cached, e.w, at_crease(pixel, p.xyz, out_normal.xyz));
}
