// The radiance behind everything: the sky's, or none where the backdrop is no light. irrsplat/image/backdrop.py has the uniforms.
#include "lighting/sky.glsl"

uniform mat3 pixel_rays;  // times (x, y, 1) in pixels: a ray's direction, of any length
uniform int sky_is_seen;  // 0: the backdrop is something else, which is no light

vec3 sky_behind(vec2 at)
{
    return sky_radiance(dot(normalize(pixel_rays * vec3(at, 1.0)), sky_up));
}

vec3 backdrop_radiance(vec2 at)
{
    return sky_is_seen != 0 ? sky_behind(at) : vec3(0.0);
}
