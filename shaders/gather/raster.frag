// Radiance that leaves the surface towards the record, drawn as the scene is: whatever is in front comes last.
#include "gather/raster_texel.glsl"

in vec3 v_normal;
in vec3 v_albedo;
in vec3 v_emission;

void main()
{
    see(gl_PrimitiveID, texel_ray(), v_normal, v_albedo, v_emission);
}
