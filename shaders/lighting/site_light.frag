// Direct irradiance at sites of the surface cache: the mean over a disc with the area that a site represents, because the spot of
// a light close to a wall may lie between sites.
#include "lighting/lights.glsl"
#include "lib/normals.glsl"

uniform sampler2D sites;  // three texels per site: position, and area, m²; shading normal; geometric normal
#if SHADOW_RAYS
uniform vec2 reach;        // least and greatest distance along the geometric normal, metres: a nearer surface is that of the site
#endif

const int POINTS = 16;  // points per disc

layout(location = 0) out vec4 out_irradiance;  // rgb: W/m²; with SHADOW_RAYS a: distance to the first surface in `reach`, metres

void main()
{
    ivec2 first = ivec2(3, 1) * ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(sites, first);
    vec3 n = texel_at(sites, first + ivec2(1, 0)).xyz, g = texel_at(sites, first + ivec2(2, 0)).xyz;
    vec3 right = perpendicular(g), up = cross(g, right);
    float r2 = INV_PI * p.w / float(POINTS);  // squared radius of a disc with the area of one point
    out_irradiance = vec4(0.0);
    for (int i = 0; i < LIGHTS; ++i)
    {
        vec4 light = light_table[i * LIGHT_ROWS + LIGHT_POSITION];
        vec3 E = vec3(0.0);
        for (int k = 0; k < POINTS; ++k)
        {
            // Vogel's spiral: points with equal areas
            float angle = GOLDEN_ANGLE * float(k), r = sqrt(r2 * (float(k) + 0.5));
            vec3 point = p.xyz + r * (cos(angle) * right + sin(angle) * up), to_light = light.xyz - point;
            float d2 = dot(to_light, to_light);
            E += light_irradiance(i, Receiver(point, n, g, FLAT)) * (light.w > 0.5 ? 1.0 : d2 / (d2 + r2));
        }
        if (E.r + E.g + E.b > 0.0) out_irradiance.rgb += E / float(POINTS) * visibility(i, Receiver(p.xyz, n, g, FLAT), 4, vec2(1.0, 0.0));
    }
#if SHADOW_RAYS
    out_irradiance.a = bvh_between(p.xyz, g, reach.x, reach.y).t;
#endif
}
