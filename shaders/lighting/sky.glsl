// The sky: brighter above, or with SKY_MAP a map; irrsplat/lighting/sky.py has the uniforms.
#include "generated/constants.glsl"

#if SKY_MAP
uniform sampler2D sky_light;  // W/(m² sr), in the square of equal areas (irrsplat/sky/sphere.py), with coarser levels
uniform mat3 sky_from_world;  // rows: east, up and south of the map

// Where a unit direction lies in that square, 0..1: the zenith in its middle, the nadir in its corners (Clarberg 2008).
vec2 sky_square(vec3 d)
{
    vec3 a = abs(d);
    float r = sqrt(max(1.0 - a.y, 0.0)), phi = atan(min(a.x, a.z) / max(max(a.x, a.z), 1e-20)) * (2.0 * INV_PI);
    phi = a.x < a.z ? 1.0 - phi : phi;
    vec2 q = vec2(r - phi * r, phi * r);
    if (d.y < 0.0) q = 1.0 - q.yx;
    return 0.5 + 0.5 * vec2(d.x < 0.0 ? -q.x : q.x, d.z < 0.0 ? -q.y : q.y);
}

// The mean radiance of about `solid` steradians around a unit direction, in the sky's axes.
vec3 sky_radiance(vec3 d, float solid)
{
    float side = float(textureSize(sky_light, 0).x), texel = SKY_RAY_TEXELS * 4.0 * PI / (side * side);
    return textureLod(sky_light, sky_square(d), 0.5 * log2(max(solid / texel, 1.0))).rgb;
}

// The rotation from a record's frame into the sky's axes.
#define SkyFrame mat3
SkyFrame sky_frame(mat3 frame)
{
    return sky_from_world * frame;
}

// The radiance along a ray in a record's frame; w: its cosθ·dω.
vec3 sky_along(vec4 direction, SkyFrame frame)
{
    return sky_radiance(frame * direction.xyz, direction.w / direction.z);
}

// Approximate irradiance from an unoccluded sky on a surface of this normal.
vec3 sky_irradiance(vec3 normal)
{
    return PI * sky_radiance(sky_from_world * normal, 2.0);
}
#else
uniform vec3 sky;           // mean radiance, W/(m² sr)
uniform vec3 sky_gradient;  // added radiance at the zenith
uniform vec3 sky_up;        // unit, world space

// The radiance of a unit direction whose cosine with the up vector is `rise`.
vec3 sky_radiance(float rise)
{
    return sky + sky_gradient * rise;
}

// The up vector in a record's frame.
#define SkyFrame vec3
SkyFrame sky_frame(mat3 frame)
{
    return sky_up * frame;
}

// The radiance along a ray in a record's frame.
vec3 sky_along(vec4 direction, SkyFrame up)
{
    return sky_radiance(dot(direction.xyz, up));
}
#endif
