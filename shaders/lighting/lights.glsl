// Direct irradiance from all lights, with shadow maps (Jones 2010, 2.4, 3.3; METHOD.md, 9.1, 9.2).
// irrsplat/lighting/light_table.py makes the light table and the tiles of the shadow maps. Light i has LIGHT_ROWS rows from
// i·LIGHT_ROWS on, see LightRow in irrsplat/core/buffers.py.
#include "generated/constants.glsl"
#include "lib/texel.glsl"
#if SHADOW_RAYS
#include "lib/rays/bvh.glsl"
#endif

// Defines by light_defines: LIGHTS is the number of lights, and each other LIGHTS_… is 1 if any light has the named property.
// Unused code is not compiled, because software renderers run both sides of every branch. ANYWHERE: receivers may lie outside of
// the scene's bounding box.
uniform vec4 light_table[LIGHT_ROWS * max(LIGHTS, 1)];
uniform sampler2D shadow_depth;  // tiles of all lights, side by side
uniform vec3 shadow_layout;      // side of a tile in texels, tiles per row, depth of perspective tiles in metres

#if LIGHTS_WITH_LUMINAIRE
// From irrsplat/lighting/luminaire_table.py: the rotation of each luminaire, and the photometries of all luminaires.
uniform vec4 luminaire_table[LUMINAIRE_ROWS * LIGHTS];
uniform sampler2D photometry;

const float BEYOND = 1e-3;  // degrees: greatest rounding of a direction beyond the ends of a photometry

// Return the position of `angle` between `count` ascending angles: number of the last angle that is not greater, and fraction of
// the interval to the next one. The angles are in texels of the photometry, from `first` in steps of `step`.
vec2 angle_position(ivec2 first, ivec2 step, int count, float angle)
{
    int low = 0, high = count - 1;
    for (int i = 0; i < PHOTOMETRY_HALVINGS; ++i)
    {
        int middle = (low + high) >> 1;
        bool up = texel_at(photometry, first + middle * step).r <= angle;
        low = up ? middle : low;
        high = up ? high : middle;
    }
    float below = texel_at(photometry, first + low * step).r, above = texel_at(photometry, first + min(low + 1, count - 1) * step).r;
    return vec2(float(low), clamp((angle - below) / max(above - below, 1e-9), 0.0, 1.0));
}

// Return the radiant intensity of light i in the unit direction w, W/sr per unit of its colour; 1 without a luminaire.
float luminaire_intensity(int i, vec3 w)
{
    i *= LUMINAIRE_ROWS;
    vec4 zero = luminaire_table[i], quarter = luminaire_table[i + 1], pole = luminaire_table[i + 2];
    if (zero.w < 0.0) return 1.0;
    int row = int(zero.w), last = int(pole.w);
    float x = dot(w, zero.xyz), y = dot(w, quarter.xyz), across = length(vec2(x, y));
    float polar = degrees(atan(across, dot(w, pole.xyz))), azimuth = degrees(atan(y, across > 0.0 ? x : 1.0));
    float first = texel_at(photometry, ivec2(0, row + 1)).r;
    azimuth = first + mod(azimuth - first, 360.0);
    if (last > 1 && azimuth > texel_at(photometry, ivec2(0, row + last)).r + BEYOND) return 0.0;
    int columns = int(quarter.w);
    if (polar < texel_at(photometry, ivec2(1, row)).r - BEYOND || polar > texel_at(photometry, ivec2(columns, row)).r + BEYOND) return 0.0;
    vec2 p = angle_position(ivec2(1, row), ivec2(1, 0), columns, polar), a = angle_position(ivec2(0, row + 1), ivec2(0, 1), last, azimuth);
    ivec2 corner = ivec2(1 + int(p.x), row + 1 + int(a.x)), right = ivec2(1, 0), up = ivec2(0, last > 1 ? 1 : 0);
    float low = mix(texel_at(photometry, corner).r, texel_at(photometry, corner + right).r, p.y);
    float high = mix(texel_at(photometry, corner + up).r, texel_at(photometry, corner + up + right).r, p.y);
    return mix(low, high, a.y);
}
#endif

// A point that receives light.
struct Receiver
{
    vec3 p;  // position, world space, metres
    vec3 n;  // unit shading normal, on the viewer's side
    vec3 g;  // unit geometric normal, on this side
    float rise;  // bias in texels: FLAT, or CURVED if neighbouring facets may rise above the plane. Records sum
                 // the leaks of CURVED, and use FLAT.
};

// A receiver in the coordinates of a shadow tile. Depth is 0..1 in a parallel tile, and -1/z in a perspective tile. Both increase
// away from the light, and are affine in x and y on a plane.
struct Projected
{
    int tile;         // number of the tile
    vec3 q;           // position: |x|, |y| <= z in a perspective tile, <= 1 in a parallel one
    vec3 m;           // normal of the tangent plane: m·q = k
    float k;
    float range;      // depth of a parallel tile, metres; 0: perspective
    vec2 texel;       // position in the tile, texels
    vec2 corner;      // first texel of the tile
    vec3 plane;       // dot product with (texel, 1): depth of the tangent plane
    float depth;      // depth of the position
    float least;      // lower limit of the plane's depth
    float tolerance;  // least depth of an occluder in front of the plane
    float separation; // at a greater depth in front of or behind the plane, a surface is certainly another one
};

const float BIAS = 0.1;       // bias of depth, in sizes of a texel, for rounding
const float FLAT = 0.02;      // texels by which a rasteriser may shift a triangle
const float CURVED = 0.5;     // texels: in a concave fold, the next facet rises above the plane of this one
const float SEPARATION = 2.0; // in sizes of a texel, plus three texels of slope
const float CASCADE_GUARD = 1.03;  // cascades are used up to 3 % before their border, so that filter taps stay inside
const float STRAIGHT = 0.9999;  // least cosine between interpolated and geometric normal on a flat surface

// Return the depth of the receiver's tangent plane minus the stored depth, `offset` texels from the receiver: positive for an
// occluder. The plane's depth is that at the texel's centre, so that a plane does not shadow itself at any slope. x: with a plane
// that is nowhere deeper than the receiver, because a wall on a floor is no occluder; y: with the plane itself.
vec2 shadow_gaps(Projected r, vec2 offset)
{
    vec2 texel = clamp(floor(r.texel + offset), vec2(0.0), vec2(shadow_layout.x - 1.0));
    float stored = texel_at(shadow_depth, ivec2(r.corner + texel)).r;
    float plane = dot(r.plane, vec3(texel + 0.5, 1.0));
    vec2 expected = vec2(clamp(plane, r.least, r.depth), plane);
#if LIGHTS_PARALLEL
#ifdef ANYWHERE
    if (r.range > 0.0 && stored == 1.0) return vec2(0.0);  // no occluder, and perhaps a receiver beyond the tile's depth
#endif
    if (r.range > 0.0) return expected - stored;
#endif
    return stored < 1.0 ? expected + 1.0 / max(stored * shadow_layout.z, 1e-20) : expected;
}

// Return the first of the `shadow_gaps`.
float shadow_gap(Projected r, vec2 offset)
{
    return shadow_gaps(r, offset).x;
}

// Set the tile of a point light that contains d = p - light, and map d and g to its axes. light_table.py has these six tiles.
void cube_tile(vec3 d, vec3 g, inout Projected t)
{
    vec3 s = abs(d);
    if (s.x >= s.y && s.x >= s.z)
    {
        t.tile += d.x > 0.0 ? 0 : 1;
        t.q = d.x > 0.0 ? d.zyx : vec3(d.yz, -d.x);
        t.m = d.x > 0.0 ? g.zyx : vec3(g.yz, -g.x);
    }
    else if (s.y >= s.z)
    {
        t.tile += d.y > 0.0 ? 2 : 3;
        t.q = d.y > 0.0 ? d.xzy : vec3(d.zx, -d.y);
        t.m = d.y > 0.0 ? g.xzy : vec3(g.zx, -g.y);
    }
    else
    {
        t.tile += d.z > 0.0 ? 4 : 5;
        t.q = d.z > 0.0 ? d.yxz : vec3(d.xy, -d.z);
        t.m = d.z > 0.0 ? g.yxz : vec3(g.xy, -g.z);
    }
}

#if SHADOW_RAYS
// Return 1 if no surface lies between the receiver and light i, else 0.
float shadow_ray(int i, Receiver r)
{
    vec4 light = light_table[i * LIGHT_ROWS + LIGHT_POSITION];
    float gap = ROUNDING * shadow_layout.z;  // metres, at the receiver and at the light
    vec3 origin = r.p + gap * r.g, to_light = light.w > 0.5 ? light.xyz : light.xyz - origin;
    float distance = length(to_light), end = light.w > 0.5 ? FARTHEST_HIT : distance - gap;
    return float(bvh_between(origin, to_light / distance, 0.0, end).t >= end);
}
#endif

#if SHADOW_MARKS
bool undecided = false;  // true if the shadow samples of a light differ, so that a ray must decide
#endif

// Return the lit share, 0..1, of `taps` dithered shadow samples of light i. rotation: cosine and sine of their rotation.
float visibility(int i, Receiver r, int taps, vec2 rotation)
{
    int row = i * LIGHT_ROWS;
    vec4 cone = light_table[row + LIGHT_CONE];
    vec3 d = r.p - light_table[row + LIGHT_POSITION].xyz;
    bool parallel = LIGHTS_PARALLEL > 0 && light_table[row + LIGHT_POSITION].w > 0.5;
    Projected t;
    t.tile = int(cone.z);
    t.range = parallel ? cone.x : 0.0;
    t.k = dot(r.g, d);
    float scale = cone.w;
#if LIGHTS_WITH_CUBE
    if (LIGHTS_WITH_TILE == 0 || light_table[row + LIGHT_COLOR].w > 1.5)
    {
        cube_tile(d, r.g, t);
        t.q.xy *= cone.w;
        t.m.xy /= cone.w;
    }
#endif
#if LIGHTS_WITH_TILE
    if (LIGHTS_WITH_CUBE == 0 || light_table[row + LIGHT_COLOR].w < 1.5)
    {
        mat3x4 rows = mat3x4(light_table[row + LIGHT_TILE], light_table[row + LIGHT_TILE + 1], light_table[row + LIGHT_TILE + 2]);
        t.q = vec4(r.p, 1.0) * rows;
        // the rows are scaled, so that the inverse transpose maps the normal
        t.m = vec4(r.g, 0.0) * rows / vec3(cone.w * cone.w, cone.w * cone.w, parallel ? 1.0 / (t.range * t.range) : 1.0);
        if (parallel ? any(greaterThan(abs(t.q.xy), vec2(1.0))) : t.q.z <= 0.0) return 1.0;
#if LIGHTS_CASCADED
        // the tile of the narrowest texels around the eye that contains the receiver
        vec3 around = parallel ? light_table[row + LIGHT_FALLOFF].xyz : vec3(0.0);
        vec2 away = t.q.xy - around.xy;
        float inside = max(max(abs(away.x), abs(away.y)) * CASCADE_GUARD, 1e-20);
        float number = clamp(floor(-log2(inside) / log2(CASCADE_RATIO)), 0.0, around.z);
        float narrower = pow(CASCADE_RATIO, number);
        t.tile += int(number);
        t.q.xy = number > 0.0 ? away * narrower : t.q.xy;
        t.m.xy /= narrower;
        scale *= narrower;
#endif
    }
#endif
    float side = shadow_layout.x, width = 2.0 / (side * scale);  // width of a texel, metres; perspective: at distance 1
    float line = floor((float(t.tile) + 0.5) / shadow_layout.y);  // floats, because integer division is slow on software renderers
    t.corner = vec2(float(t.tile) - line * shadow_layout.y, line) * side;
    t.texel = (((parallel ? t.q.xy : t.q.xy / t.q.z) * 0.5 + 0.5) * side);
    // On the plane m·q = k, -1/z is -m·(x, y, 1)/k at (x, y) = 2·texel/side - 1; in a parallel tile z is affine in x and y.
    vec3 m = parallel ? vec3(-t.m.xy / (abs(t.m.z) > 1e-6 ? t.m.z : 1e-6), 0.0) : t.m * (-1.0 / t.k);
    t.plane = vec3(m.xy * (2.0 / side), m.z - m.x - m.y);
    float slope = abs(t.plane.x) + abs(t.plane.y), bias = parallel ? width / t.range : width / t.q.z;
    t.depth = parallel ? t.q.z : -1.0 / t.q.z;
    t.least = parallel ? t.depth - 99.0 * bias : 2.0 * t.depth;
    if (parallel) t.plane.z = t.depth - dot(t.plane.xy, t.texel);
    float rounding = parallel ? ROUNDING : ROUNDING * shadow_layout.z / (t.q.z * max(abs(t.k), 1e-20));
    t.tolerance = BIAS * bias + r.rise * slope + rounding;
    t.separation = SEPARATION * bias + 3.0 * slope + rounding;
    if (taps == 1)
    {
        // The texel of a flat receiver shows the receiver, or the texel's centre lies past an edge. In the latter case, the
        // diagonal neighbour in the direction of the point's quarter lies inside of the edge. Software renderers always read
        // three texels; if the first one decides, the other reads repeat it from the processor's cache.
        vec2 gaps = shadow_gaps(t, vec2(0.0));
        float gap = gaps.x;
        bool decides = gaps.y >= (dot(r.n, r.g) > STRAIGHT ? -2.0 * t.tolerance : -t.separation);
        vec2 inward = decides ? vec2(0.0) : sign(fract(t.texel) - 0.5);
        // near a second edge, only one axis: across a receiver that is edge-on to the light
        if (shadow_gap(t, inward) < -t.separation) inward *= abs(t.plane.x) > abs(t.plane.y) ? vec2(1.0, 0.0) : vec2(0.0, 1.0);
        float neighbour = shadow_gap(t, inward);
        return float(decides || neighbour < -t.separation ? gap <= t.tolerance : neighbour <= rounding);
    }
#if SHADOW_RAYS || SHADOW_MARKS
    // The receiver is lit if all four texels around it show its plane, and in shadow if all four show an occluder. Otherwise a
    // ray decides, in a second draw, because a loop would make the whole program slow on software renderers.
    vec4 gaps = vec4(shadow_gap(t, vec2(-0.5)), shadow_gap(t, vec2(0.5, -0.5)), shadow_gap(t, vec2(-0.5, 0.5)), shadow_gap(t, vec2(0.5)));
    bool lit = all(lessThanEqual(gaps, vec4(t.tolerance))) && all(greaterThanEqual(gaps, vec4(-t.separation)));
    bool dark = all(greaterThan(gaps, vec4(t.separation)));
#if SHADOW_MARKS
    vec4 shows = vec4(greaterThanEqual(gaps, vec4(-t.separation))), free = shows * vec4(lessThanEqual(gaps, vec4(t.tolerance)));
    undecided = undecided || !(lit || dark);
    return lit || dark ? float(lit) : dot(free, vec4(1.0)) / max(dot(shows, vec4(1.0)), 1.0);
#else
    float share = lit ? 1.0 : 0.0;
    bool open = !lit && !dark;
    while (open)  // a loop, because software renderers run an `if` for all pixels
    {
        share = shadow_ray(i, r);
        open = false;
    }
    return share;
#endif
#else
    // lit.y counts texels that show the receiver. A texel past an edge of the receiver shows a surface far behind: in a corner of
    // two thin walls, this surface lies outdoors, and the texel would light one wall through the other.
    mat2 turn = mat2(rotation.x, rotation.y, -rotation.y, rotation.x);
    vec2 lit = vec2(0.0);
    for (int s = 0; s < taps; ++s)
    {
        float gap = shadow_gap(t, turn * (vec2(s & 1, s >> 1) - 0.5));  // texels
        lit += gap >= -t.separation ? vec2(gap <= t.tolerance, 1.0) : vec2(0.0);
    }
    return lit.y > 0.0 ? lit.x / lit.y : 1.0;
#endif
}

// Return the unshadowed irradiance by light i, W/m². spread: cosθ/d², the solid angle of the receiver from the light, per m².
vec3 light_irradiance(int i, Receiver r, out float spread)
{
    int row = i * LIGHT_ROWS;
    vec4 position = light_table[row + LIGHT_POSITION];
    vec3 color = light_table[row + LIGHT_COLOR].rgb;
    vec4 falloff = light_table[row + LIGHT_FALLOFF];
    vec4 spot = light_table[row + LIGHT_SPOT];
    bool parallel = LIGHTS_PARALLEL > 0 && position.w > 0.5;
    vec3 to_light = parallel ? position.xyz : position.xyz - r.p;
    float d2 = max(dot(to_light, to_light), 1e-20);
    float d = sqrt(d2);
    vec3 l = to_light / d;
    float facing = dot(r.g, l), cosine = facing > 0.0 ? max(dot(r.n, l), 0.0) : 0.0;
    spread = max(facing, 0.0) / d2;
    float strength = parallel ? 1.0 : 1.0 / max(dot(falloff.xyz, vec3(1.0, d, d2)), 1e-20);
#if LIGHTS_WITH_CONE
    if (spot.w > 0.5)
    {
        vec4 cone = light_table[row + LIGHT_CONE];
        float c = clamp(-dot(spot.xyz, l), -1.0, 1.0);
        float angle = acos(c);
        float edge = cone.x > cone.y ? clamp((cone.x - angle) / (cone.x - cone.y), 0.0, 1.0) : (angle <= cone.x ? 1.0 : 0.0);
        strength *= edge * (falloff.w > 0.0 ? pow(max(c, 0.0), falloff.w) : 1.0);
    }
#endif
#if LIGHTS_WITH_LUMINAIRE
    strength *= luminaire_intensity(i, -l);
#endif
    return min(color * cosine * strength, vec3(1e30));  // finite even if a light touches a surface
}

// Return the unshadowed irradiance by light i, W/m².
vec3 light_irradiance(int i, Receiver r)
{
    float spread;
    return light_irradiance(i, r, spread);
}

// Return the irradiance by light i, W/m².
vec3 irradiance_by(int i, Receiver r, int taps, vec2 rotation)
{
    vec3 E = light_irradiance(i, r);
    return E.r + E.g + E.b > 0.0 ? E * visibility(i, r, taps, rotation) : vec3(0.0);
}

// Return the direct irradiance, W/m², with `taps` (1 or 4) shadow samples per light.
vec3 direct_irradiance(Receiver r, int taps, vec2 rotation)
{
    vec3 sum = vec3(0.0);
    // three unrolled steps, because software renderers run one iteration more than a loop has
#if LIGHTS > 0
    sum += irradiance_by(0, r, taps, rotation);
#endif
#if LIGHTS > 1
    sum += irradiance_by(1, r, taps, rotation);
#endif
#if LIGHTS > 2
    sum += irradiance_by(2, r, taps, rotation);
#endif
    for (int i = 3; i < LIGHTS; ++i) sum += irradiance_by(i, r, taps, rotation);
    return sum;
}
