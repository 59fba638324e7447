// Radiance that leaves the surface towards the record, drawn as the scene is: whatever is in front comes last.
#include "gather/raster_texel.glsl"
#include "generated/interpolated.glsl"

void main()
{
    see(gl_PrimitiveID, texel_ray(), v_normal, interpolated_material());
}
