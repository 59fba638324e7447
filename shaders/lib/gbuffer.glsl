// Access to the g-buffer of a view, drawn by image/gbuffer.frag (Jones 2010, 3.2).
#include "image/gbuffer_material.glsl"
#include "lib/normals.glsl"
#include "lib/texel.glsl"

uniform sampler2D position;  // world space, metres; w: depth along the view axis, metres, 0 without a surface
uniform sampler2D normal;    // unit shading normal, world space; w here and in albedo: octahedral geometric normal

// Return the unit geometric normal at a pixel, on the viewer's side.
vec3 geometric_normal_at(ivec2 pixel)
{
    return octahedral_decode(vec2(texel_at(normal, pixel).w, texel_at(albedo, pixel).w));
}

// Return the number of the triangle at a pixel.
int triangle_at(ivec2 pixel)
{
    return int(texel_at(emission, pixel).w);
}
