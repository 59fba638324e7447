// The signed error of irradiance against its path-traced reference, the mean of the channels: white is right.
#include "viewer/buffers/picture.glsl"

uniform sampler2D reference;  // irradiance; a: 1 where there is a surface
uniform float full;       // W/m2: the error in full colour
uniform vec3 bright;      // colour of too much light
uniform vec3 dark;        // of too little
uniform vec3 unseen;      // of no surface

vec3 picture(ivec2 pixel, float depth)
{
    vec4 s = texelFetch(values, pixel, 0), t = texelFetch(reference, pixel, 0);
    if (t.a == 0.0) return unseen;
    float error = dot(s.rgb / (s.a > 0.0 ? s.a : 1.0) - t.rgb, vec3(1.0 / 3.0)) / full;
    return mix(vec3(1.0), error > 0.0 ? bright : dark, min(abs(error), 1.0));
}
