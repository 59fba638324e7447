// Direct irradiance at sites of a table, each the mean over a disc of the area that it represents: a light close to a wall
// makes a spot that may lie between sites.
#include "lighting/lights.glsl"
#include "lib/normals.glsl"

uniform sampler2D sites;  // three texels each: place and the area that it stands for, shading normal, geometric normal
#if SHADOW_RAYS
uniform vec2 reach;        // metres along the geometric normal: a surface at the site itself is nearer than the first
#endif

const int POINTS = 16;  // of a disc

layout(location = 0) out vec4 out_irradiance;  // rgb W/m²; with SHADOW_RAYS a: metres to the first surface along the geometric normal, at most reach.y

void main()
{
    ivec2 at = ivec2(3, 1) * ivec2(gl_FragCoord.xy);
    vec4 p = texel_at(sites, at);
    vec3 n = texel_at(sites, at + ivec2(1, 0)).xyz, g = texel_at(sites, at + ivec2(2, 0)).xyz;
    vec3 right = perpendicular(g), up = cross(g, right);
    float part = INV_PI * p.w / float(POINTS);  // a point's share of the disc, as the square of a radius
    out_irradiance = vec4(0.0);
    for (int i = 0; i < LIGHTS; ++i)
    {
        vec4 lamp = light_table[i * LIGHT_ROWS + LIGHT_POSITION];
        vec3 E = vec3(0.0);
        for (int k = 0; k < POINTS; ++k)
        {
            // Vogel's spiral: points of equal shares of the disc
            float angle = GOLDEN_ANGLE * float(k), r = sqrt(part * (float(k) + 0.5));
            vec3 place = p.xyz + r * (cos(angle) * right + sin(angle) * up), away = lamp.xyz - place;
            float d2 = dot(away, away);
            E += light_irradiance(i, Receiver(place, n, g, FLAT)) * (lamp.w > 0.5 ? 1.0 : d2 / (d2 + part));
        }
        if (E.r + E.g + E.b > 0.0) out_irradiance.rgb += E / float(POINTS) * visibility(i, Receiver(p.xyz, n, g, FLAT), 4, vec2(1.0, 0.0));
    }
#if SHADOW_RAYS
    out_irradiance.a = bvh_between(p.xyz, g, reach.x, reach.y).t;
#endif
}
