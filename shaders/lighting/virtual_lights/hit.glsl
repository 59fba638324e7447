// Balance-heuristic share of direct light at ray hits; virtual point lights (irrsplat/lighting/virtual_lights.py) add the rest.
uniform vec4 virtual_lights[max(LIGHTS, 1)];  // of each light: its rays per steradian, and the square of the greatest distance of
                                              // its virtual point lights, m² (0: it has none)
#if LIGHTS_PARALLEL
uniform vec4 virtual_windows[LIGHTS];         // of directional ones, for which x counts to a square metre: middle and half the sides of
                                              // the window through which they are sent, metres in the shadow map's axes
#endif

// The balance heuristic (Veach and Guibas 1995) for a hit at p, `away` from the eye, of a surface with normal g. rays: their density
// per steradian. spread: see light_irradiance.
float light_share(int light, vec3 p, float spread, vec3 away, vec3 g, float rays)
{
    vec2 source = virtual_lights[light].xy;
    vec3 lit = p - light_table[light * LIGHT_ROWS + LIGHT_POSITION].xyz;
    float r2 = dot(away, away), found = max(rays, 0.0) * abs(dot(g, away)) / max(r2 * sqrt(r2), 1e-30);
    bool within = dot(lit, lit) < source.y;
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
    return 1.0 - samples / max(found + samples, 1e-30);
}
