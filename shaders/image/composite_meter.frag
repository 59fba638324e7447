// The exposure meter (METHOD.md, 10.2): the sum of log₂ (Y/ρ) over the lit pixels of a block, and the number of these pixels. Y
// is the luminance, and ρ that of the reflectance.
#include "generated/constants.glsl"
#include "image/gbuffer_material.glsl"

uniform sampler2D image;     // linear radiance
uniform sampler2D position;  // g-buffer
uniform ivec2 block;         // size of a block, pixels

layout(location = 0) out vec4 out_log;

void main()
{
    ivec2 corner = ivec2(gl_FragCoord.xy) * block, end = min(corner + block, textureSize(image, 0));
    out_log = vec4(0.0);
    for (int y = corner.y; y < end.y; ++y)
        for (int x = corner.x; x < end.x; ++x)
        {
            Material material = material_at(ivec2(x, y));
            bool reflects = texel_at(position, ivec2(x, y)).w > 0.0 && material.emission == vec3(0.0);
            float reflectance = reflects ? max(dot(material.albedo, LUMINANCE), DARKEST) : MID_GREY;
            float Y = dot(texel_at(image, ivec2(x, y)).rgb, LUMINANCE) / reflectance;
            if (Y > 0.0) out_log += vec4(log2(max(Y, 1e-37)), 1.0, 0.0, 0.0);
        }
}
