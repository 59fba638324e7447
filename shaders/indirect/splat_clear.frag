// Clears the splat buffer: sums of 0, and the weight NOTHING_SEEN without a surface or at an unlit side (METHOD.md, 7.1).
#include "generated/constants.glsl"
#include "indirect/splat_depth.glsl"
#if UNLIT_SIDES
#include "lib/gbuffer.glsl"
#include "lib/surface.glsl"
#else
#include "lib/texel.glsl"
uniform sampler2D position;  // g-buffer
#endif

uniform int pixel_stride;    // pixels of the g-buffer per pixel of the sums, in x and y
#if UNLIT_SIDES
uniform sampler2D unlit_sides;  // one texel per triangle: 1 if no light reaches the inner side
uniform bool all_unlit;         // true if the camera lies in a closed mesh without a light
#endif

layout(location = 0) out vec4 out_sums;    // see splat.frag
layout(location = 1) out vec2 out_weight;

// Return true if a record at the pixel would be black, because the surface lies within a closed mesh without a light.
bool unlit(ivec2 pixel)
{
#if UNLIT_SIDES
    if (all_unlit) return true;
    int triangle = triangle_at(pixel);
    return texel_at(unlit_sides, table_texel(triangle)).r > 0.0 && dot(geometric_normal_at(pixel), face_plane(triangle).xyz) < 0.0;
#else
    return false;
#endif
}

void main()
{
    out_sums = vec4(0.0);
    ivec2 pixel = pixel_stride * ivec2(gl_FragCoord.xy);
    float depth = texel_at(position, pixel).w;
    depth = unlit(pixel) ? 0.0 : depth;
    out_weight = vec2(depth > 0.0 ? 0.0 : NOTHING_SEEN, 0.0);
    gl_FragDepth = depth > 0.0 ? splat_depth(depth) : 0.0;
}
