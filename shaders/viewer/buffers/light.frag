// Direct and indirect irradiance in false colours on a linear or a logarithmic scale, with lines between its steps.
#include "viewer/buffers/picture.glsl"

uniform sampler2D direct;       // direct irradiance, W/m2; `values` holds Σ k·E and Σ k of indirect light
uniform vec3 weights;           // factors of red, green and blue from W/m2 to the unit of the scale
uniform float low;              // lower end of the scale; 0 for a linear scale
uniform float high;
uniform float steps;            // number of steps with a line between each two; 0 for no lines
uniform vec3 ground;            // display colour of pixels without a surface
uniform vec3 palette[FALSE_COLOURS];  // display colours from low to high

const float SAME = 0.02;  // relative difference in depth of neighbours on one surface
const float LINE = 0.35;  // factor on the colour of a line

// Return the position of a pixel's light on the scale: 0 at the lower end, 1 at the upper end.
float scale_position(ivec2 pixel)
{
    vec4 s = texelFetch(values, pixel, 0);
    float light = dot(texelFetch(direct, pixel, 0).rgb + s.rgb / (s.a > 0.0 ? s.a : 1.0), weights);
    float t = low > 0.0 ? log(max(light, 1e-30) / low) / log(high / low) : light / high;
    return clamp(t, 0.0, 1.0);
}

// Return true if a step of the scale lies between this pixel and its neighbour on the same surface.
bool crosses(float t, float depth, ivec2 neighbour)
{
    ivec2 pixel = min(neighbour, textureSize(values, 0) - 1);
    float d = texelFetch(position, pixel, 0).w;
    // the upper end belongs to the last step
    float last = steps - 1.0;
    return abs(d - depth) < SAME * depth && min(floor(t * steps), last) != min(floor(scale_position(pixel) * steps), last);
}

vec3 picture(ivec2 pixel, float depth)
{
    if (depth == 0.0) return ground;
    float t = scale_position(pixel), at = t * float(FALSE_COLOURS - 1);
    int i = min(int(at), FALSE_COLOURS - 2);
    vec3 colour = mix(palette[i], palette[i + 1], at - float(i));
    bool line = steps > 0.0 && (crosses(t, depth, pixel + ivec2(1, 0)) || crosses(t, depth, pixel + ivec2(0, 1)));
    return line ? LINE * colour : colour;
}
