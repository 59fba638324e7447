// A record on a tile of places that do not lie as on a screen, such as the texels of a lightmap; an instance is a record and a tile
// that it may reach. The fragments are those of indirect/splat.frag.
#include "records/view_radius.glsl"

uniform sampler2D pairs;     // by number: x record, yz the tile's first texel
uniform vec2 texels;         // width and height of the places
uniform float tile;          // texels along a side of a tile

flat out vec3 v_place;       // as in indirect/splat.vert
flat out vec3 v_normal;
flat out vec3 v_axis;
flat out vec2 v_radii;
flat out float v_share;
flat out float v_sure;
#if GRADIENTS
flat out vec2 v_curvature;
flat out mat3 v_m;
flat out mat3 v_g;
#else
flat out vec3 v_irradiance;
#endif

void main()
{
    vec4 pair = texelFetch(pairs, table_texel(gl_InstanceID), 0);
    ivec2 texel = table_texel(int(pair.x));
    float trust;
    Ellipse ellipse = view_ellipse(texel, 1.0, trust);  // from everywhere as from a metre away: the bounds are the same for all
    v_place = record_position(texel);
    v_axis = ellipse.axis;
    v_radii = vec2(ellipse.along, ellipse.across) / a;
    v_normal = record_normal(texel);
    v_share = record_share(texel);
    v_sure = 1.0 - record_noise(texel) * record_noise(texel);
#if GRADIENTS
    v_m = record_vectors(texel);
    v_g = record_gradient(texel) * trust;
    v_curvature = usable_curvature(texel) * trust * trust;
#else
    v_irradiance = record_irradiance(texel);
#endif
    vec2 corner = pair.yz + tile * vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = vec4(2.0 * corner / texels - 1.0, 0.0, 1.0);
}
