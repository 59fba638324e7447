// One step of the filter of probes (METHOD.md, 8.2): an edge-avoiding à-trous wavelet (Dammertz et al. 2010). Its weight falls with
// the distance in R, as a record's weight does, and with the number of samples that a cell has already.
#include "indirect/holes/states.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;  // of the cells: world space; w: depth, 0 without a surface
uniform sampler2D normal;    // of the cells
uniform sampler2D rest;      // of the cells: z is the state
uniform sampler2D light;     // Σ E and number of samples
uniform sampler2D near;      // Σ 1/R and number of probes
uniform int step_size;       // distance of samples in cells
uniform bool far;            // true if cells with light stay as they are
uniform float width;         // of a cell at distance 1, metres

layout(location = 0) out vec4 out_light;  // Σ E and effective number of samples
layout(location = 1) out vec2 out_near;   // Σ 1/R and effective number of probes

const float WITHIN = 0.3;      // of R: distance at which the weight is 1/e
const float RISE = 0.25;       // of the distance: height above a tangent plane at which the weight is 1/e
const float LEAST_RISE = 0.3;  // widths of a cell: least such height
const float OTHER = 1e-6;      // least weight, and that of other surfaces for cells with less light on their own
const float ENOUGH = 4.0;      // samples of a cell, beyond which the weight of other cells falls

void main()
{
    ivec2 cell = ivec2(gl_FragCoord.xy), last = textureSize(position, 0) - 1;
    vec4 p = texel_at(position, cell);
    vec3 n = texel_at(normal, cell).xyz;
    vec2 own = texel_at(near, cell).xy;
    float nearness = own.x / max(own.y, 1e-20);
    out_light = texel_at(light, cell);
    out_near = own;
    float state = texel_at(rest, cell).z;
    // Without a probe, the distance of surfaces around a record is not known. The sky passes light on to thin objects between its cells.
    bool covered = p.w > 0.0 && (state == 0.0 || state == COARSE && own.y == 0.0);
    if (covered || far && out_light.a > 0.0) return;
    float others = min(ENOUGH / max(out_light.a, 1e-20), 1.0);
    vec4 other_light = vec4(0.0);
    vec2 other_near = vec2(0.0);
    for (int i = 0; i < 9; ++i)
    {
        ivec2 off = ivec2(i % 3, i / 3) - 1, at = cell + step_size * off;
        if (off == ivec2(0) || at != clamp(at, ivec2(0), last)) continue;
        vec4 q = texel_at(position, at), E = texel_at(light, at);
        if (E.a == 0.0) continue;
        vec3 m = texel_at(normal, at).xyz, offset = q.xyz - p.xyz;
        vec2 other = texel_at(near, at).xy;
        float d = length(offset), rise = max(abs(dot(offset, n)), abs(dot(offset, m)));
        rise /= max(RISE * d + LEAST_RISE * width * p.w, 1e-20);
        float apart = d * max(nearness, other.x / max(other.y, 1e-20)) / WITHIN, facing = max(dot(n, m), 0.0);
        facing *= facing * facing;
        facing *= facing;
        float kernel = off.x == 0 || off.y == 0 ? 0.5 : 0.25;  // relative to the cell's own weight
        float similarity = facing * facing * exp(-rise * rise - apart * apart);
        float weight = similarity < OTHER ? 0.0 : others * kernel * similarity;
        out_light += weight * E;
        out_near += weight * other;
        other_light += OTHER * kernel * E;
        other_near += OTHER * kernel * other;
    }
    if (out_light.a >= OTHER) return;
    out_light += other_light;
    out_near += other_near;
}
