// The approximate number of pixels that a record covers in a view, for the order of refreshes (METHOD.md, 13). A fragment is a
// record. Samples of the g-buffer in the record's bounding box on screen estimate the number.
#include "records/view_radius.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform mat4 clip_from_world;
uniform float pixel;         // size of a pixel at distance 1, metres
uniform int count;           // number of records

layout(location = 0) out float out_pixels;

const int SAMPLES = 5;  // samples along each side of the bounding box

ivec2 texel;
vec3 p, n_k;
Ellipse ellipse;

// Return true if the record contributes to a pixel.
bool covers(ivec2 at)
{
    vec4 q = texelFetch(position, at, 0);
    vec3 offset = q.xyz - p;
    vec2 R = vec2(ellipse.along, ellipse.across) / a;
    return q.w > 0.0 && record_weight(offset, ellipse.axis, R, texelFetch(normal, at, 0).xyz, n_k) > 1.0 / a;
}

void main()
{
    texel = ivec2(gl_FragCoord.xy);
    out_pixels = 0.0;
    if (texel.y * TABLE_COLUMNS + texel.x >= count) return;
    p = record_position(texel);
    n_k = record_normal(texel);
    float trust;
    ellipse = view_ellipse(texel, length(eye - p), trust);

    // bounding box, in pixels, of a cube around the record's sphere
    vec4 clip = clip_from_world * vec4(p, 1.0);
    vec2 size = vec2(textureSize(position, 0)), r = 2.0 * ellipse.along / (pixel * size), depths = clip.w + vec2(-1.0, 1.0) * ellipse.along;
    if (depths.y <= 0.0) return;  // behind the eye
    vec2 low = vec2(0.0), high = size;
    if (depths.x > 0.0)
    {
        low = min((clip.xy - r) / depths.x, (clip.xy - r) / depths.y);
        high = max((clip.xy + r) / depths.x, (clip.xy + r) / depths.y);
        low = clamp((low * 0.5 + 0.5) * size, vec2(0.0), size);
        high = clamp((high * 0.5 + 0.5) * size, vec2(0.0), size);
    }
    if (any(greaterThanEqual(low, high))) return;
    ivec2 last = ivec2(size) - 1, centre = ivec2(floor((clip.xy / clip.w * 0.5 + 0.5) * size));
    bool visible = clip.w > 0.0 && all(greaterThanEqual(centre, ivec2(0))) && all(lessThanEqual(centre, last));
    int covered = 0;
    for (int i = 0; i < SAMPLES * SAMPLES; ++i)
    {
        vec2 at = low + (high - low) * (vec2(i % SAMPLES, i / SAMPLES) + 0.5) / float(SAMPLES);
        covered += covers(min(ivec2(at), last)) ? 1 : 0;
    }
    float minimum = visible && covers(centre) ? 1.0 : 0.0;  // at grazing angles, all samples may miss the record
    out_pixels = max(float(covered) / float(SAMPLES * SAMPLES) * (high.x - low.x) * (high.y - low.y), minimum);
}
