// Cells of a view for the light of holes (METHOD.md, 8.2): the surface at one pixel of each square of pixels, and the irradiance
// of records or of the surface cache there. A fragment is a cell.
#include "generated/constants.glsl"
#include "indirect/holes/states.glsl"
#include "lib/gbuffer.glsl"
#if SURFACE
#include "surface_cache/lookup.glsl"
#endif

uniform sampler2D sums;     // Σ k·E, Σ k of the records
uniform int side;           // width of a cell in pixels, even
uniform bool coarse;        // true while coarse light lights the records
uniform int pixel_stride;   // pixels of the g-buffer per pixel of the sums, in x and y

layout(location = 0) out vec4 out_position;  // world space, metres; w: depth, 0 without a surface
layout(location = 1) out vec4 out_normal;    // shading normal; w: octahedral x of the geometric normal
layout(location = 2) out vec4 out_rest;      // octahedral y of the geometric normal, number of the triangle; state
layout(location = 3) out vec4 out_light;     // Σ E and number of samples: the records' irradiance counts as AS_RECORD samples
layout(location = 4) out vec2 out_near;      // Σ 1/R of probes in 1/m, and their number

const float AS_RECORD = 16.0;  // a record by coarse light counts as one sample, and is filtered, too
const float AS_SURFACE = 0.1;  // samples as which the surface cache's irradiance counts: it shows where no probe is near

void main()
{
    ivec2 pixel = min(ivec2(gl_FragCoord.xy) * side + side / 2, textureSize(position, 0) - 1);
    pixel -= ivec2(mod(vec2(pixel), float(pixel_stride)));
    vec4 s = texel_at(sums, pixel / pixel_stride);
    out_position = texel_at(position, pixel);
    out_normal = texel_at(normal, pixel);
    bool covered = s.a > COVERED;
    float state = out_position.w == 0.0 ? 0.0 : covered ? (coarse ? COARSE : 0.0) : HOLE;
    out_rest = vec4(texel_at(albedo, pixel).w, texel_at(emission, pixel).w, state, 0.0);
    out_light = covered ? (coarse ? 1.0 : AS_RECORD) * vec4(s.rgb / s.a, 1.0) : vec4(0.0);
#if SURFACE
    if (out_rest.z > 0.0 && !covered)
        out_light = AS_SURFACE * vec4(surface_irradiance_at(triangle_at(pixel), out_position.xyz, geometric_normal_at(pixel)).rgb, 1.0);
#endif
    out_near = vec2(0.0);
}
