// The radiance of the sky: linear in the height of the direction, or with SKY_MAP a map (METHOD.md, 1, 9.3).
// irrsplat/lighting/sky.py sets the uniforms.
#include "generated/constants.glsl"

#if SKY_MAP
uniform sampler2D sky_light;  // W/(m² sr), equal-area square of irrsplat/sky/sphere.py, with mipmaps
uniform mat3 sky_from_world;  // rows: east, up and south of the map

// Return the position, 0..1, of a unit direction in the square: zenith in the centre, nadir in the corners (Clarberg 2008).
vec2 sky_square(vec3 d)
{
    vec3 a = abs(d);
    float r = sqrt(max(1.0 - a.y, 0.0)), phi = atan(min(a.x, a.z) / max(max(a.x, a.z), 1e-20)) * (2.0 * INV_PI);
    phi = a.x < a.z ? 1.0 - phi : phi;
    vec2 q = vec2(r - phi * r, phi * r);
    if (d.y < 0.0) q = 1.0 - q.yx;
    return 0.5 + 0.5 * vec2(d.x < 0.0 ? -q.x : q.x, d.z < 0.0 ? -q.y : q.y);
}

// Return the mean radiance over about `solid_angle` sr around a unit direction in the sky's axes.
vec3 sky_radiance(vec3 d, float solid_angle)
{
    float side = float(textureSize(sky_light, 0).x), texel = SKY_RAY_TEXELS * 4.0 * PI / (side * side);
    return textureLod(sky_light, sky_square(d), 0.5 * log2(max(solid_angle / texel, 1.0))).rgb;
}

// Return the rotation from a record's frame to the sky's axes.
#define SkyFrame mat3
SkyFrame sky_frame(mat3 frame)
{
    return sky_from_world * frame;
}

// Return the radiance along a ray in a record's frame; w: its cosθ·dω.
vec3 sky_along(vec4 direction, SkyFrame frame)
{
    return sky_radiance(frame * direction.xyz, direction.w / direction.z);
}
#else
uniform vec3 sky;           // mean radiance, W/(m² sr)
uniform vec3 sky_gradient;  // additional radiance at the zenith, W/(m² sr)
uniform vec3 sky_up;        // unit, world space

// Return the radiance of a direction; rise: its cosine with the up vector.
vec3 sky_radiance(float rise)
{
    return sky + sky_gradient * rise;
}

// Return the up vector in a record's frame.
#define SkyFrame vec3
SkyFrame sky_frame(mat3 frame)
{
    return sky_up * frame;
}

// Return the radiance along a ray in a record's frame.
vec3 sky_along(vec4 direction, SkyFrame up)
{
    return sky_radiance(dot(direction.xyz, up));
}
#endif
