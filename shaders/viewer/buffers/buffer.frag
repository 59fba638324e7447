// A buffer of the view as a picture. Of the blocks below, one for every way of showing, one define keeps one; SQUARES is what two
// of them share.
#include "generated/constants.glsl"
#include "lib/display.glsl"
#include "viewer/buffers/colours.glsl"

uniform sampler2D position;  // g-buffer; w depth along the view axis, 0 where nothing is seen
uniform sampler2D values;    // the buffer itself
uniform vec2 scale;          // pixels of the view per pixel of the target

layout(location = 0) out vec4 out_color;

#if RADIANCE
uniform float gain;   // the exposure as a factor
uniform bool whole;   // whether the buffer holds something where the pixel's centre sees nothing
uniform vec3 unseen;  // else, what stands there

vec3 picture(ivec2 pixel, float depth)
{
    return display((whole || depth > 0.0 ? texelFetch(values, pixel, 0).rgb : unseen) * gain);
}
#endif

#if SQUARES
uniform int stride;    // pixels of the view, in x and in y, per texel
uniform ivec2 margin;  // pixels by which the texels overlap the view to the left and below

ivec2 cell_of(ivec2 pixel)
{
    return (pixel + margin) / stride;
}
#endif

#if IRRADIANCE
uniform float gain;

// as a white surface would send it out, so that it compares with the picture
vec3 picture(ivec2 pixel, float depth)
{
    vec4 s = texelFetch(values, cell_of(pixel), 0);
    return s.a > 0.0 ? display(s.rgb / s.a * INV_PI * gain) : vec3(0.0);
}
#endif

#if ERROR
uniform sampler2D truth;  // irradiance, a texel for the pixel in the middle of stride x stride ones; a: there is a surface
uniform float full;       // W/m2: the error in full colour
uniform vec3 bright;      // colours of too much light, too little, and of no surface
uniform vec3 dark;
uniform vec3 unseen;

vec3 picture(ivec2 pixel, float depth)
{
    ivec2 cell = cell_of(pixel);
    ivec2 middle = clamp(cell * stride + stride / 2 - margin, ivec2(0), textureSize(values, 0) - 1);
    vec4 s = texelFetch(values, middle, 0), t = texelFetch(truth, cell, 0);
    if (t.a == 0.0) return unseen;
    float error = dot(s.rgb / (s.a > 0.0 ? s.a : 1.0) - t.rgb, vec3(1.0 / 3.0)) / full;
    return mix(vec3(1.0), error > 0.0 ? bright : dark, min(abs(error), 1.0));
}
#endif

#if INDIRECT
uniform sampler2D albedo;  // g-buffer
uniform float gain;

vec3 picture(ivec2 pixel, float depth)
{
    vec4 s = texelFetch(values, pixel, 0);
    return s.a > 0.0 ? display(texelFetch(albedo, pixel, 0).rgb * (s.rgb / s.a * INV_PI * gain)) : vec3(0.0);
}
#endif

#if UNIT
vec3 picture(ivec2 pixel, float depth)
{
    return depth > 0.0 ? encoded(texelFetch(values, pixel, 0).rgb) : vec3(0.0);
}
#endif

#if RANGE
uniform vec3 low;
uniform vec3 high;

vec3 picture(ivec2 pixel, float depth)
{
    return depth > 0.0 ? (texelFetch(values, pixel, 0).rgb - low) / (high - low) : vec3(0.0);
}
#endif

#if HEAT
uniform float low;
uniform float high;

// the depth, which lies in w
vec3 picture(ivec2 pixel, float depth)
{
    return depth > 0.0 ? heat((texelFetch(values, pixel, 0).w - low) / (high - low)) : vec3(0.0);
}
#endif

#if WEIGHT
uniform float low;
uniform float high;
uniform float threshold;  // Σw below which a pixel asks for a record

bool other_side(ivec2 pixel, bool below)
{
    float w = texelFetch(values, clamp(pixel, ivec2(0), textureSize(values, 0) - 1), 0).r;
    return w < NOTHING_SEEN && (w < threshold) != below;
}

// on a logarithmic scale; where neighbours lie on different sides of the threshold, one is white and the other black
vec3 picture(ivec2 pixel, float depth)
{
    if (depth == 0.0) return vec3(0.0);
    float w = texelFetch(values, pixel, 0).r;
    bool below = w < threshold;
    if (other_side(pixel + ivec2(1, 0), below) || other_side(pixel - ivec2(1, 0), below) ||
        other_side(pixel + ivec2(0, 1), below) || other_side(pixel - ivec2(0, 1), below)) return vec3(below ? 0.0 : 1.0);
    return heat(log(max(w, low) / low) / log(high / low));
}
#endif

#if ASKING
#include "indirect/effective_weight.glsl"

uniform sampler2D image;
uniform sampler2D sums;
uniform float gain;

// over the picture, which is dim and grey
vec3 picture(ivec2 pixel, float depth)
{
    if (effective_weight(texelFetch(values, pixel, 0).rg, texelFetch(sums, pixel, 0)) < tolerance) return vec3(1.0, 0.45, 0.05);
    return vec3(0.45 * dot(display(texelFetch(image, pixel, 0).rgb * gain), LUMINANCE));
}
#endif

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy * scale);
    out_color = vec4(picture(pixel, texelFetch(position, pixel, 0).w), 1.0);
}
