// The radiance behind everything: the sky's, or none where the backdrop is no light. irrsplat/image/backdrop.py has the uniforms.
#include "lighting/sky.glsl"

uniform mat3 pixel_rays;      // times (x, y, 1) in pixels of the whole picture: a ray's direction, of any length
uniform ivec2 picture_corner; // the pixel of the whole picture that is the first one here
uniform int sky_is_seen;  // 0: the backdrop is something else, which is no light
#if SKY_MAP
uniform sampler2D sky_seen;  // W/(m² sr), equirectangular with its middle to the north, bottom row first, with coarser levels

vec3 sky_behind(vec2 at)
{
    vec3 ray = pixel_rays * vec3(at + vec2(picture_corner), 1.0);  // of length 1 along the view axis
    float away = length(ray), texel = PI / float(textureSize(sky_seen, 0).y);
    vec3 d = sky_from_world * (ray / away);
    // the square root of the pixel's solid angle, in texels
    float width = length(pixel_rays[0]) * inversesqrt(away * away * away) / texel;
    vec2 place = vec2(0.5 + 0.5 * INV_PI * atan(d.x, -d.z), 1.0 - atan(length(d.xz), d.y) * INV_PI);
    return textureLod(sky_seen, place, max(log2(width), 0.0)).rgb;
}
#else

vec3 sky_behind(vec2 at)
{
    return sky_radiance(dot(normalize(pixel_rays * vec3(at + vec2(picture_corner), 1.0)), sky_up));
}
#endif

vec3 backdrop_radiance(vec2 at)
{
    return sky_is_seen != 0 ? sky_behind(at) : vec3(0.0);
}
