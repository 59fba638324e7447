// Radiance that leaves the surface towards the record, drawn as the scene is: whatever is in front comes last.
#include "gather/raster/texel.glsl"
#include "generated/interpolated.glsl"
#if CUT_OUTS
#include "lib/rays/cut_outs.glsl"
#endif

void main()
{
    Vertex point = interpolated_vertex(vec3(0.0));
#if TEXTURES
    vec4 u = dFdx(point.uv), v = dFdy(point.uv);  // from texel to texel
    Material material = material_mean(point, abs(vec2(u.x * v.y - u.y * v.x, u.z * v.w - u.w * v.z)));
#else
    Material material = material_of(point);
#endif
#if CUT_OUTS
    if (light_passes(point)) discard;
#endif
    see(gl_PrimitiveID, meet(gl_PrimitiveID, texel_ray()), point, material);
}
