// Last step of the reduction: a record's blocks become its irradiance, its harmonic mean distance and its gradients.
#include "generated/constants.glsl"
#include "generated/record_outputs.glsl"
#include "gather/places.glsl"
#include "lib/texel.glsl"
#if CLOSE_LIGHT
#include "surface_cache/lookup.glsl"
#endif

uniform sampler2D sums;
uniform sampler2D share;
#if GRADIENTS
uniform sampler2D sums_m_r;
uniform sampler2D sums_m_g;
uniform sampler2D sums_m_b;
uniform sampler2D sums_g_r;
uniform sampler2D sums_g_g;
uniform sampler2D sums_g_b;
#endif
uniform sampler2D frames;    // texels (i, 0..2): tangent, bitangent, normal at place i; see Atlas.frames
uniform ivec2 blocks;        // per cell
uniform int columns;         // cells per row
uniform vec2 radii;          // metres: the least and the greatest radius
#if CLOSE_LIGHT
uniform sampler2D close_light;  // a texel a record: mean luminance of E at its close hits, its part by close values of the surface
                                // cache (-1: few close hits)
#endif

const float STEPS = 2.2;     // measured ratio of the summed differences between neighbouring rays to the error of E
const float FEEDBACK = 0.9;  // greatest share of a record's light that returns to it from close hits
const float ENCLOSED = 0.2;  // least share of directions that end at inner sides; others may hit objects in that mesh

flat in int v_index;         // in the batch

#if CLOSE_LIGHT
// Ratio of a record's irradiance to `whole`, see docs/METHOD.md, 11.5. close: its part by close values of the surface cache.
// reflected: mean reflectance of the close hits. cached: the surface cache at the record. there: a texel of close_light.
float with_close_light(float whole, float close, float reflected, float cached, vec2 there)
{
    float first = (whole - close + reflected * (there.x - there.y)) / whole;  // without light that returns
    float back = min(there.y / max(cached, 1e-20), 1.0), share = min(reflected, FEEDBACK);
    // where light falls, the brighter of two solutions holds: by parallel surfaces, or in proportion to cached values
    float ratio = max(first / (1.0 - share * back), min(first / (1.0 - share * max(back, reflected)), 1.0));
    return clamp(ratio, 0.0, 2.0);
}
#endif

void main()
{
    int i = v_index;
    ivec2 corner = ivec2(i % columns, i / columns) * blocks;
    vec4 total = vec4(0.0), solid = vec4(0.0);
    mat3 M = mat3(0.0), G = mat3(0.0);
    vec3 H = vec3(0.0), axis = vec3(0.0);
    vec2 curvature = vec2(0.0);
    float max_radius = 0.0, steps = 0.0, noise = 0.0;
    for (int y = 0; y < blocks.y; ++y)
        for (int x = 0; x < blocks.x; ++x)
        {
            ivec2 at = corner + ivec2(x, y);
            total += texel_at(sums, at);
            solid += texel_at(share, at);
#if GRADIENTS
            vec4 r = texel_at(sums_m_r, at), g = texel_at(sums_m_g, at), b = texel_at(sums_m_b, at);
            M += mat3(r.xyz, g.xyz, b.xyz);
            H += vec3(r.w, g.w, b.w);
            vec4 g_b = texel_at(sums_g_b, at);
            G += mat3(texel_at(sums_g_r, at).xyz, texel_at(sums_g_g, at).xyz, g_b.xyz);
            steps += g_b.w;
#endif
        }
    // Ward et al. 1988: R = Σ cosθ·dω / Σ (cosθ·dω / r)
    float R = clamp(solid.x / max(total.a, 1e-30), radii.x, radii.y);
    vec4 normal = texel_at(frames, ivec2(i * places, 2));
    mat3 world = mat3(texel_at(frames, ivec2(i * places, 0)).xyz, texel_at(frames, ivec2(i * places, 1)).xyz, normal.xyz);
#if CLOSE_LIGHT
    vec2 there = texel_at(close_light, ivec2(i, 0)).rg;
    float plain = dot(total.rgb, LUMINANCE);
    if (normal.w >= 0.0 && there.y >= 0.0 && plain > 0.0)
    {
        vec3 g_world = world * texel_at(frames, ivec2(i * places, 3)).xyz, eye = texel_at(frames, ivec2(i * places, 4)).xyz;
        float cached = dot(surface_irradiance_at(int(normal.w), eye, g_world).rgb, LUMINANCE);
        float ratio = with_close_light(plain, solid.z, solid.w, cached, there);
        total.rgb *= ratio;
        M *= ratio;
        G *= ratio;
        H *= ratio;
        steps *= ratio * ratio;
    }
#endif
#if GRADIENTS
    M = world * M;
    G = world * G;
    // the Hessian's eigenvalues, and the axis of the lesser of them
    float middle = 0.5 * (H.x + H.z), apart = length(vec2(0.5 * (H.x - H.z), H.y));
    float lesser = middle < 0.0 ? middle + apart : middle - apart, greater = 2.0 * middle - lesser;
    vec2 along = abs(H.x - lesser) > abs(H.z - lesser) ? vec2(H.y, lesser - H.x) : vec2(lesser - H.z, H.y);
    along = dot(along, along) > 0.0 ? normalize(along) : vec2(1.0, 0.0);
    axis = world * vec3(along, 0.0);
    curvature = vec2(lesser, greater) / max(dot(total.rgb, LUMINANCE), 1e-20);
    curvature = clamp(curvature, -1e30, 1e30);  // unreduced in the dark: next to a shadow's edge it shows that light is near
    // WIDE is settings.py's: a bound however little the light curves. The unlit inside of a closed mesh is
    // invisible: only rounding shows pixels of it, and their records contribute to no other pixel.
    // It receives no light, except along rays that begin within rounding of the mesh's side.
    bool dark = total.r + total.g + total.b == 0.0 || R <= radii.x, enclosed = dark && solid.y > ENCLOSED * solid.x;
    // next-event estimation adds to E and hardly to its error; rays without light mean little
    float Y = dot(total.rgb, LUMINANCE);
    noise = Y > 0.0 ? min(sqrt(steps) / (STEPS * Y), 1.0) : 1.0;
    max_radius = enclosed ? 0.0 : min(radii.y, WIDE * R);
#else
    noise = places > 1 ? solid.z : 0.0;  // of several eyes unknown; for the light at close hits, its part by close values
    M = outerProduct(normal.xyz, total.rgb);  // E = n_k·M, whatever the pixel's normal
#endif
    write_record(total.rgb, R, M, G, axis, curvature, max_radius, noise);
}
