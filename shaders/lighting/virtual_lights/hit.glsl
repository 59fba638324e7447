// Of a lamp's light on what rays hit: the share that counts, since virtual lights (irrsplat/lighting/virtual_lights.py) bring the rest.
uniform vec4 virtual_lights[max(LIGHTS, 1)];  // of each lamp: rays that it sends into a steradian, and the square of how far from it
                                              // what they hit is a virtual light, m² (0: it has none)

// The balance heuristic (Veach and Guibas 1995): of rays of so many a steradian, which hit what lies `away` from the eye at a surface
// with normal g, at p. spread: as light_irradiance has it.
float lamp_share(int light, vec3 p, float spread, vec3 away, vec3 g, float rays)
{
    vec2 lamp = virtual_lights[light].xy;
    vec3 lit = p - light_table[light * LIGHT_ROWS + LIGHT_POSITION].xyz;
    float r2 = dot(away, away), found = max(rays, 0.0) * abs(dot(g, away)) / max(r2 * sqrt(r2), 1e-30);
    float samples = dot(lit, lit) < lamp.y ? WORTH * lamp.x * spread : 0.0;
    return 1.0 - samples / max(found + samples, 1e-30);
}
