// The g-buffer of a view, as image/gbuffer.frag draws it.
#include "generated/gbuffer_material.glsl"
#include "lib/normals.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;  // w: depth along the view axis, 0 without a surface
uniform sampler2D normal;    // shading normal; w: the first octahedral number of the geometric normal, and w of albedo the second

vec3 geometric_normal_at(ivec2 pixel)
{
    return octahedral_decode(vec2(texel_at(normal, pixel).w, texel_at(albedo, pixel).w));
}

int triangle_at(ivec2 pixel)
{
    return int(texel_at(emission, pixel).w);
}
