// Radiance that leaves the surface towards the record, drawn as the scene is: whatever is in front comes last.
#include "gather/raster_texel.glsl"
#include "generated/interpolated.glsl"

void main()
{
    vec3 q = texel_ray();
    see(gl_PrimitiveID, q, interpolated_vertex(vec3(0.0)));
}
