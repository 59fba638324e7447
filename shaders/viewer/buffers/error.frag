// The signed error of irradiance against its path-traced reference, as the mean of the channels. White means no error.
#include "viewer/buffers/picture.glsl"

uniform sampler2D reference;  // irradiance, W/m2; a: 1 at a surface, else 0
uniform float full;       // W/m2: the error in full colour
uniform vec3 bright;      // colour of too much light
uniform vec3 dark;        // colour of too little light
uniform vec3 unseen;      // colour of pixels without a surface

vec3 picture(ivec2 pixel, float depth)
{
    vec4 s = texelFetch(values, pixel, 0), t = texelFetch(reference, pixel, 0);
    if (t.a == 0.0) return unseen;
    float error = dot(s.rgb / (s.a > 0.0 ? s.a : 1.0) - t.rgb, vec3(1.0 / 3.0)) / full;
    return mix(vec3(1.0), error > 0.0 ? bright : dark, min(abs(error), 1.0));
}
