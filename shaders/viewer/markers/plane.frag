// Measured values in false colours with isolines, bilinear between the points with a value.
#include "generated/constants.glsl"
#include "lib/normals.glsl"

uniform sampler2D position;  // g-buffer; w depth along the view axis, 0 without a surface
uniform sampler2D normal;
uniform sampler2D albedo;
uniform float pixel;         // size of a pixel at distance 1, in metres
uniform vec2 scale;           // pixels of the view per pixel of the target
uniform sampler2D places;     // by point: r its position 0..1 on the scale, g 1 if it has a value, else 0
uniform float steps;          // number of steps with a line between each two; 0 for no lines
uniform float opacity;
uniform vec3 palette[FALSE_COLOURS];  // display colours from low to high

in vec3 v_position;
in vec2 v_at;

layout(location = 0) out vec4 out_color;

const float LINE = 0.35;  // factor on the colour of a line
const float WIDTH = 0.8;  // half the width of a line, pixels

// Return true if p lies behind the plane of the visible surface at the pixel, by more than a pixel's size. A test of depths alone
// is not enough: at grazing angles depths differ much from pixel to pixel, and a surface would hide its own markers.
bool hidden(vec3 p, ivec2 at)
{
    at = clamp(at, ivec2(0), textureSize(position, 0) - 1);
    vec4 q = texelFetch(position, at, 0);
    vec3 g = octahedral_decode(vec2(texelFetch(normal, at, 0).w, texelFetch(albedo, at, 0).w));
    return q.w > 0.0 && dot(p - q.xyz, g) < -pixel * q.w;
}

void main()
{
    ivec2 size = textureSize(places, 0);
    vec2 at = v_at * vec2(size) - 0.5, share = fract(at), sum = vec2(0.0);
    for (int i = 0; i < 4; ++i)
    {
        ivec2 step = ivec2(i & 1, i >> 1);
        vec2 value = texelFetch(places, clamp(ivec2(floor(at)) + step, ivec2(0), size - 1), 0).rg;
        vec2 near = mix(1.0 - share, share, vec2(step));
        sum += near.x * near.y * value.y * vec2(value.x, 1.0);
    }
    float t = sum.x / max(sum.y, 1e-6), level = t * steps, change = fwidth(level);
    if (sum.y < 0.5 || hidden(v_position, ivec2(gl_FragCoord.xy * scale))) discard;
    float along = t * float(FALSE_COLOURS - 1);
    int i = min(int(along), FALSE_COLOURS - 2);
    vec3 colour = mix(palette[i], palette[i + 1], along - float(i));
    float line = abs(fract(level + 0.5) - 0.5);
    bool crossed = steps > 0.0 && line < WIDTH * change && level > 0.5 && level < steps - 0.5;
    out_color = crossed ? vec4(LINE * colour, 1.0) : vec4(colour, opacity);
}
