// The pixels of the spot check (METHOD.md, 7.3): position and cached luminance at one pixel per square of a view, for comparison
// with a probe.
#include "generated/constants.glsl"
#include "lib/gbuffer.glsl"

uniform sampler2D sums;      // Σ k·E, Σ k of all pixels
uniform float pixel_size;    // size of a pixel at distance 1, metres
uniform int stride;          // pixels along a side of the squares; each square has one probed pixel
uniform ivec2 corner;        // first pixel of the drawn part, in the whole picture
uniform ivec2 whole;         // size of the whole picture in pixels
uniform ivec2 first;         // column and row of the first square

layout(location = 0) out vec4 out_position;  // w: 1 if records contribute and the surface emits no more than it reflects
layout(location = 1) out vec4 out_normal;    // shading normal; w: octahedral x of the geometric normal
layout(location = 2) out vec4 out_rest;      // octahedral y of the geometric normal, luminance of E, W/m², triangle; 1 at a crease

const float STEEP = 0.2;      // least sine of the angle between a plane and the direction to a surface above the plane
const float FAR = 8.0;        // greatest distance to the surface, in pixel sizes per pixel on screen

// Return 1 if a surface within MARGIN pixels rises above the plane at p with normal n, else 0. At the foot of a ledge, light
// changes within the height of the ledge, and all records around agree.
float at_crease(ivec2 pixel, vec3 p, vec3 n)
{
    float crease = 0.0;
    for (int i = 0; i < 4 * MARGIN; ++i)
    {
        int pixels = 1 + i / 4;
        ivec2 step = (i & 2) == 0 ? ivec2(pixels, 0) : ivec2(0, pixels);
        ivec2 at = pixel + ((i & 1) == 0 ? step : -step);
        if (at + corner != clamp(at + corner, ivec2(0), whole - 1)) continue;
        vec4 neighbour = texel_at(position, clamp(at, ivec2(0), textureSize(position, 0) - 1));
        vec3 offset = neighbour.xyz - p;
        float d = length(offset);
        if (neighbour.w > 0.0 && dot(offset, n) > STEEP * d && d < FAR * pixel_size * neighbour.w * float(pixels)) crease = 1.0;
    }
    return crease;
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
