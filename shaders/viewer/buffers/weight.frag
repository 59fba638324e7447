// Σw by the colour map on a logarithmic scale, with the contour of the threshold. Pixels below the threshold request a record.
#include "viewer/buffers/picture.glsl"

uniform float low;   // Σw at the first and the last colour
uniform float high;
uniform float threshold;

// Return true if a pixel lies on the other side of the threshold.
bool other_side(ivec2 pixel, bool below)
{
    float w = texelFetch(values, clamp(pixel, ivec2(0), textureSize(values, 0) - 1), 0).r;
    return w < NOTHING_SEEN && (w < threshold) != below;
}

// Return the colour of Σw. If two neighbours lie on different sides of the threshold, the greater is white, and the lesser black.
vec3 picture(ivec2 pixel, float depth)
{
    if (depth == 0.0) return vec3(0.0);
    float w = texelFetch(values, pixel, 0).r;
    bool below = w < threshold;
    if (other_side(pixel + ivec2(1, 0), below) || other_side(pixel - ivec2(1, 0), below) ||
        other_side(pixel + ivec2(0, 1), below) || other_side(pixel - ivec2(0, 1), below)) return vec3(below ? 0.0 : 1.0);
    return heat(log(max(w, low) / low) / log(high / low));
}
