// The picture, exposed and tone-mapped, in front of a backdrop that emits no light. SMOOTHED: 1 if the shape of edges smooths them
// (METHOD.md, 10.3).
#include "viewer/buffers/picture.glsl"

uniform sampler2D alpha;  // the share of a pixel that shows a surface
uniform bool plain;       // true if the picture already contains its background
uniform vec3 lower;       // display colours of the backdrop at the lower and the upper edge
uniform vec3 upper;
uniform float gain;       // the exposure as a factor

#if SMOOTHED
const float EDGE = 0.03;   // least contrast of an edge, in brightness
const float END = 0.25;    // least change of brightness at the end of an edge, as a share of its contrast
const float SPECK = 0.75;  // share of the neighbour in a pixel that differs from all pixels around
const int LONGEST = 8;     // pixels of an edge to either side

// Return the brightness at a place in the picture, 0..1, about as perceived; of green alone, which software renderers read faster.
float brightness(vec2 at)
{
    float Y = gain * textureLod(values, at, 0.0).g;
    return sqrt(Y / (1.0 + Y));
}

// Return the way from a pixel across its edge, and the share of the pixel on the other side; 0 without an edge (FXAA, Lottes 2009).
vec3 edge_at(vec2 at, vec2 pixel)
{
    vec2 x = vec2(pixel.x, 0.0), y = vec2(0.0, pixel.y);
    float here = brightness(at);
    vec4 beside = vec4(brightness(at - x), brightness(at + x), brightness(at - y), brightness(at + y));
    vec2 low = min(beside.xy, beside.zw), high = max(beside.xy, beside.zw);
    float contrast = max(max(high.x, high.y), here) - min(min(low.x, low.y), here);
    vec4 corners = vec4(brightness(at - x - y), brightness(at + x - y), brightness(at - x + y), brightness(at + x + y));
    float rows = 2.0 * abs(beside.z - 2.0 * here + beside.w) + abs(corners.x - 2.0 * beside.x + corners.z) +
                 abs(corners.y - 2.0 * beside.y + corners.w);
    float columns = 2.0 * abs(beside.x - 2.0 * here + beside.y) + abs(corners.x - 2.0 * beside.z + corners.y) +
                    abs(corners.z - 2.0 * beside.w + corners.w);
    bool level = rows >= columns;
    vec2 sides = level ? beside.zw : beside.xy, along = level ? x : y, across = level ? y : x;
    bool second = abs(sides.y - here) > abs(sides.x - here);
    if (!second) across = -across;
    float other = second ? sides.y : sides.x, middle = 0.5 * (here + other), end = END * abs(other - here);
    vec2 lengths = vec2(0.0), changes = vec2(0.0);
    for (int i = 0; i < 2; ++i)
        for (int k = 1; k <= LONGEST && contrast >= EDGE && abs(changes[i]) < end; ++k)
        {
            vec2 to = at + float(i == 0 ? k : -k) * along;
            changes[i] = 0.5 * (brightness(to) + brightness(to + across)) - middle;
            lengths[i] = float(k) - 0.5;
        }
    vec2 near = lengths.x < lengths.y ? vec2(lengths.x, changes.x) : vec2(lengths.y, changes.y);
    bool beyond = (near.y < 0.0) != (here < middle);  // the other side begins within the pixel
    float share = beyond ? 0.5 - near.x / (lengths.x + lengths.y) : 0.0;
    float mean = (2.0 * dot(beside, vec4(1.0)) + dot(corners, vec4(1.0))) / 12.0;
    float alone = smoothstep(0.0, contrast, abs(mean - here));
    return contrast >= EDGE ? vec3(across, max(share, SPECK * alone * alone)) : vec3(0.0);
}
#endif

vec3 picture(ivec2 pixel, float depth)
{
    vec2 size = vec2(textureSize(values, 0)), uv = gl_FragCoord.xy * scale / size;  // sampled with the texture's own filter
    vec4 light = vec4(textureLod(values, uv, 0.0).rgb, textureLod(alpha, uv, 0.0).r);
#if SMOOTHED
    vec3 edge = edge_at(uv, 1.0 / size);
    light = mix(light, vec4(textureLod(values, uv + edge.xy, 0.0).rgb, textureLod(alpha, uv + edge.xy, 0.0).r), edge.z);
#endif
    float share = plain ? 1.0 : light.a;
    vec3 behind = mix(lower, upper, (float(pixel.y) + 0.5) / size.y);
    vec3 shown = display(light.rgb * (gain / max(share, 1e-6)));
    return share > 0.0 ? mix(behind, shown, share) : behind;
}
