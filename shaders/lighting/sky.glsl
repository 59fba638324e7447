// The sky, brighter above: irrsplat/lighting/sky.py has the uniforms.
uniform vec3 sky;           // mean radiance, W/(m² sr)
uniform vec3 sky_gradient;  // how much brighter it is straight up
uniform vec3 sky_up;        // unit, world space

// What comes from a unit direction whose cosine with the up vector is `rise`.
vec3 sky_radiance(float rise)
{
    return sky + sky_gradient * rise;
}
