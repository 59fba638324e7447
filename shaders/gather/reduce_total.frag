// Last step of the reduction: the sums of all blocks of a record become its irradiance, harmonic mean distance and derivatives
// (Jones 2010, 2.1; METHOD.md, 3.5, 3.6, 5.3, 11.5). Inputs: the outputs of gather/reduce_blocks.frag.
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
uniform sampler2D frames;    // texels (i, 0..2): tangent, bitangent, normal at eye i; see Atlas.frames
uniform ivec2 blocks;        // columns and rows of blocks per cell
uniform int columns;         // cells per row
uniform vec2 radii;          // least and greatest radius, metres
#if CLOSE_LIGHT
uniform sampler2D close_light;  // one texel per record: mean luminance of E at the close hits, and the part of this mean by close
                                // values of the surface cache (-1: too few close hits)
#endif

const float NOISE_DIVISOR = 2.2;  // measured ratio of √(Σ squared differences between neighbouring rays) to the standard error of E
const float FEEDBACK = 0.9;  // greatest share of a record's light that returns from close hits: the geometric series must converge
const float ENCLOSED = 0.2;  // least share of directions that hit inner sides: the rest may hit objects in the closed mesh

flat in int v_index;  // index of the record in the batch

#if CLOSE_LIGHT
// Return the ratio E'/E of a record's corrected to its plain luminance (METHOD.md, 11.5). C: part of E by close values of the
// surface cache. K: mean reflectance of the close hits. S: value of the surface cache at the record. E_close: a texel of
// close_light. All are luminances.
float with_close_light(float E, float C, float K, float S, vec2 E_close)
{
    float first = (E - C + K * (E_close.x - E_close.y)) / E;  // E_1/E, without light that returns to the record
    float feedback = min(E_close.y / max(S, 1e-20), 1.0), share = min(K, FEEDBACK);
    // if the light decreases, the greater of two solutions holds: for parallel surfaces, or in proportion to the cached values
    float ratio = max(first / (1.0 - share * feedback), min(first / (1.0 - share * max(feedback, K)), 1.0));
    return clamp(ratio, 0.0, 2.0);
}
#endif

void main()
{
    int i = v_index;
    ivec2 corner = ivec2(i % columns, i / columns) * blocks;
    vec4 total = vec4(0.0), shares = vec4(0.0);
    mat3 M = mat3(0.0), G = mat3(0.0);
    vec3 H = vec3(0.0), axis = vec3(0.0);
    vec2 curvature = vec2(0.0);
    float max_radius = 0.0, squares = 0.0, noise = 0.0;
    for (int y = 0; y < blocks.y; ++y)
        for (int x = 0; x < blocks.x; ++x)
        {
            ivec2 at = corner + ivec2(x, y);
            total += texel_at(sums, at);
            shares += texel_at(share, at);
#if GRADIENTS
            vec4 r = texel_at(sums_m_r, at), g = texel_at(sums_m_g, at), b = texel_at(sums_m_b, at);
            M += mat3(r.xyz, g.xyz, b.xyz);
            H += vec3(r.w, g.w, b.w);
            vec4 g_b = texel_at(sums_g_b, at);
            G += mat3(texel_at(sums_g_r, at).xyz, texel_at(sums_g_g, at).xyz, g_b.xyz);
            squares += g_b.w;
#endif
        }
    // Ward et al. 1988: R = Σ cosθ·dω / Σ (cosθ·dω / r)
    float R = clamp(shares.x / max(total.a, 1e-30), radii.x, radii.y);
    vec4 normal = texel_at(frames, ivec2(i * places, 2));
    mat3 world = mat3(texel_at(frames, ivec2(i * places, 0)).xyz, texel_at(frames, ivec2(i * places, 1)).xyz, normal.xyz);
#if CLOSE_LIGHT
    vec2 E_close = texel_at(close_light, ivec2(i, 0)).rg;
    float Y_plain = dot(total.rgb, LUMINANCE);
    if (normal.w >= 0.0 && E_close.y >= 0.0 && Y_plain > 0.0)
    {
        vec3 g_world = world * texel_at(frames, ivec2(i * places, 3)).xyz, eye = texel_at(frames, ivec2(i * places, 4)).xyz;
        float cached = dot(surface_irradiance_at(int(normal.w), eye, g_world).rgb, LUMINANCE);
        float ratio = with_close_light(Y_plain, shares.z, shares.w, cached, E_close);
        total.rgb *= ratio;
        M *= ratio;
        G *= ratio;
        H *= ratio;
        squares *= ratio * ratio;
    }
#endif
#if GRADIENTS
    M = world * M;
    G = world * G;
    // eigenvalues of the Hessian, and the eigenvector of the eigenvalue of lesser magnitude
    float mean = 0.5 * (H.x + H.z), half_gap = length(vec2(0.5 * (H.x - H.z), H.y));
    float lesser = mean < 0.0 ? mean + half_gap : mean - half_gap, greater = 2.0 * mean - lesser;
    vec2 along = abs(H.x - lesser) > abs(H.z - lesser) ? vec2(H.y, lesser - H.x) : vec2(lesser - H.z, H.y);
    along = dot(along, along) > 0.0 ? normalize(along) : vec2(1.0, 0.0);
    axis = world * vec3(along, 0.0);
    curvature = vec2(lesser, greater) / max(dot(total.rgb, LUMINANCE), 1e-20);
    curvature = clamp(curvature, -1e30, 1e30);  // large values in the dark stay: they show that the edge of a shadow is near
    // WIDE, from settings.py, bounds radii where the light hardly curves. The unlit inside of a closed mesh is visible only by
    // rounding, so that a record there may cover no pixel but its own. It has no light, or rays that begin within rounding of the
    // mesh.
    bool dark = total.r + total.g + total.b == 0.0 || R <= radii.x, enclosed = dark && shares.y > ENCLOSED * shares.x;
    // next-event estimation adds light, but hardly any error; a record without light has an unknown error, here 100 %
    float Y = dot(total.rgb, LUMINANCE);
    noise = Y > 0.0 ? min(sqrt(squares) / (NOISE_DIVISOR * Y), 1.0) : 1.0;
    max_radius = enclosed ? 0.0 : min(radii.y, WIDE * R);
#else
    noise = places > 1 ? shares.z : 0.0;  // unknown without differences; gathers at close hits return their part by close values
    M = outerProduct(normal.xyz, total.rgb);  // so that E = n_k·M
#endif
    write_record(total.rgb, R, M, G, axis, curvature, max_radius, noise);
}
