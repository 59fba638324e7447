// The radiance of the background: that of the sky, or 0 for a backdrop that emits no light. irrsplat/image/backdrop.py sets the
// uniforms.
#include "lighting/sky.glsl"

uniform mat3 pixel_rays;      // maps (x, y, 1) in pixels of the whole picture to the direction of a ray, of any length
uniform ivec2 picture_corner; // first pixel of this part, in the whole picture
uniform int sky_is_seen;  // 1: the sky is visible; 0: another backdrop without light
#if SKY_MAP
uniform sampler2D sky_seen;  // W/(m² sr), equirectangular, centre to the north, bottom row first, with mipmaps

// Return the radiance of the sky at `at` in pixels.
vec3 sky_behind(vec2 at)
{
    vec3 ray = pixel_rays * vec3(at + vec2(picture_corner), 1.0);  // length 1 along the view axis
    float distance = length(ray), texel = PI / float(textureSize(sky_seen, 0).y);
    vec3 d = sky_from_world * (ray / distance);
    // square root of the pixel's solid angle, in texels
    float width = length(pixel_rays[0]) * inversesqrt(distance * distance * distance) / texel;
    vec2 uv = vec2(0.5 + 0.5 * INV_PI * atan(d.x, -d.z), 1.0 - atan(length(d.xz), d.y) * INV_PI);
    return textureLod(sky_seen, uv, max(log2(width), 0.0)).rgb;
}
#else

vec3 sky_behind(vec2 at)
{
    return sky_radiance(dot(normalize(pixel_rays * vec3(at + vec2(picture_corner), 1.0)), sky_up));
}
#endif

// Return the radiance of the background at `at` in pixels.
vec3 backdrop_radiance(vec2 at)
{
    return sky_is_seen != 0 ? sky_behind(at) : vec3(0.0);
}
