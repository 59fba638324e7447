// The weight of direct light at a ray's hit (METHOD.md, 3.8). Virtual point lights (irrsplat/lighting/virtual_lights.py) add the
// remainder.
uniform vec4 virtual_lights[max(LIGHTS, 1)];  // per light: rays per steradian, squared greatest distance of virtual point lights,
                                              // m² (0: none)
#if LIGHTS_PARALLEL
uniform vec4 virtual_windows[LIGHTS];         // directional lights (with rays per m² above): centre and half sides of the
                                              // window of the rays, metres in the shadow map's axes
#endif

// Return the weight of the balance heuristic (Veach and Guibas 1995) for a hit at p on a surface with normal g. to_hit: vector
// from the eye, metres. rays: rays per steradian. spread: see light_irradiance.
float light_weight(int light, vec3 p, float spread, vec3 to_hit, vec3 g, float rays)
{
    vec2 source = virtual_lights[light].xy;
    vec3 from_light = p - light_table[light * LIGHT_ROWS + LIGHT_POSITION].xyz;
    float r2 = dot(to_hit, to_hit), hit_density = max(rays, 0.0) * abs(dot(g, to_hit)) / max(r2 * sqrt(r2), 1e-30);
    bool within = dot(from_light, from_light) < source.y;
#if LIGHTS_PARALLEL
    int row = light * LIGHT_ROWS;
    if (light_table[row + LIGHT_POSITION].w > 0.5)
    {
        vec2 at = vec2(dot(light_table[row + LIGHT_TILE], vec4(p, 1.0)), dot(light_table[row + LIGHT_TILE + 1], vec4(p, 1.0)));
        vec4 window = virtual_windows[light];
        within = all(lessThan(abs(at / light_table[row + LIGHT_CONE].w - window.xy), window.zw));
    }
#endif
    float samples = within ? WORTH * source.x * spread : 0.0;
    return 1.0 - samples / max(hit_density + samples, 1e-30);
}
