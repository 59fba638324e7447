// Direct irradiance of the scene's point, spot and directional lights and luminaires, with their shadow maps. The light table and the
// tiles of the shadow maps come from irrsplat/lighting/light_table.py: light i has LIGHT_ROWS rows from i·LIGHT_ROWS on, which
// LightRow in irrsplat/core/buffers.py explains.
#include "generated/constants.glsl"
#include "lib/texel.glsl"
#if SHADOW_RAYS
#include "lib/rays/bvh.glsl"
#endif

// Defined by light_defines: LIGHTS is the number of lights, and each other LIGHTS_… is 1 if any light has the named property. Code that
// no light needs is not compiled, since software renderers run both sides of every branch. ANYWHERE: receivers may also lie outside of
// the scene's bounding box.
uniform vec4 light_table[LIGHT_ROWS * max(LIGHTS, 1)];
uniform sampler2D shadow_depth;  // every tile of every light, side by side
uniform vec3 shadow_layout;      // tile side in texels, tiles per row, metres of depth in point and spot tiles

#if LIGHTS_WITH_LUMINAIRE
// Made by irrsplat/lighting/luminaire_table.py: a rotation of each luminaire, and the photometries of all luminaires.
uniform vec4 luminaire_table[LUMINAIRE_ROWS * LIGHTS];
uniform sampler2D photometry;

const float BEYOND = 1e-3;  // degrees by which rounding may take a direction beyond the ends of a photometry

// The number of the last of `count` rising angles (but one) that is not above `angle`, and the share of the way from there to the
// next one. The angles are in the photometry's texels from `first` on, in the direction `step`.
vec2 angle_place(ivec2 first, ivec2 step, int count, float angle)
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

// The radiant intensity of light i along the unit vector w, W/sr, where its colour is 1; 1 where it is no luminaire.
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
    vec2 p = angle_place(ivec2(1, row), ivec2(1, 0), columns, polar), a = angle_place(ivec2(0, row + 1), ivec2(0, 1), last, azimuth);
    ivec2 corner = ivec2(1 + int(p.x), row + 1 + int(a.x)), right = ivec2(1, 0), up = ivec2(0, last > 1 ? 1 : 0);
    float low = mix(texel_at(photometry, corner).r, texel_at(photometry, corner + right).r, p.y);
    float high = mix(texel_at(photometry, corner + up).r, texel_at(photometry, corner + up + right).r, p.y);
    return mix(low, high, a.y);
}
#endif

struct Receiver
{
    vec3 p;  // world position
    vec3 n;  // unit shading normal, turned to the viewer
    vec3 g;  // unit geometric normal, turned to the viewer
    float rise;  // FLAT, or CURVED where neighbouring facets may lie before its plane without a shadow; records take FLAT,
                 // since they add up its leaks
};

// A receiver in the coordinates of the tile that sees it. Depths are those of a parallel tile, 0..1, or -1/z of a perspective one:
// both grow away from the light, and are affine in x and y on a plane.
struct Projected
{
    int tile;         // number of the tile in the texture
    vec3 q;           // the point: |x|, |y| <= z inside a perspective tile, <= 1 inside a parallel one
    vec3 m;           // the normal of its tangent plane: m·q = k
    float k;
    float range;      // metres of depth in a parallel tile; 0: perspective
    vec2 texel;       // where the point is in the tile, in texels
    vec2 corner;      // first texel of the tile
    vec3 plane;       // dotted with (texel, 1): the depth of the tangent plane
    float own;        // depth of the point
    float nearest;    // the least depth of the plane that counts
    float tolerance;  // an occluder less far before the plane is the plane itself
    float beside;     // a surface farther behind or before the plane is certainly another one
};

const float BIAS = 0.1;       // of depth, in sizes of a texel
const float FLAT = 0.02;      // texels by which a rasteriser may shift a triangle
const float CURVED = 0.5;     // texels: in a fold of a curved surface the next facet rises before the plane of this one
const float BESIDE = 2.0;     // as BIAS, and three steps of its slope
const float STRAIGHT = 0.9999;  // cosine of the angle between interpolated and geometric normal of a flat surface, at least

// By how much of depth the shadow map's texel `offset` texels from the receiver sees something before the receiver's tangent plane;
// below 0: behind it. The plane's depth is taken at the texel's centre, so that a plane does not shadow itself at any slope.
float shadow_gap(Projected r, vec2 offset)
{
    vec2 texel = clamp(floor(r.texel + offset), vec2(0.0), vec2(shadow_layout.x - 1.0));
    float stored = texel_at(shadow_depth, ivec2(r.corner + texel)).r;
    float expected = clamp(dot(r.plane, vec3(texel + 0.5, 1.0)), r.nearest, r.own);
#if LIGHTS_PARALLEL
#ifdef ANYWHERE
    if (r.range > 0.0 && stored == 1.0) return 0.0;  // nothing there, for a receiver beyond the tile's depth
#endif
    if (r.range > 0.0) return expected - stored;
#endif
    return stored < 1.0 ? expected + 1.0 / max(stored * shadow_layout.z, 1e-20) : expected;
}

// The tile of a point light that sees d = p - light, with d and g in that tile's axes; light_table.py has the same six tiles.
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
// 1 if nothing stands between the receiver and light i, else 0.
float shadow_ray(int i, Receiver r)
{
    vec4 light = light_table[i * LIGHT_ROWS + LIGHT_POSITION];
    float off = ROUNDING * shadow_layout.z;  // metres, off the receiver, and off the light
    vec3 from = r.p + off * r.g, to_light = light.w > 0.5 ? light.xyz : light.xyz - from;
    float distance = length(to_light), end = light.w > 0.5 ? FARTHEST_HIT : distance - off;
    return float(bvh_between(from, to_light / distance, 0.0, end).t >= end);
}
#endif

#if SHADOW_MARKS
bool undecided = false;  // true if the shadow samples of a light differ here, so that a ray has to decide
#endif

// The share, 0..1, of `taps` dithered shadow samples that light i reaches; rotation: cosine and sine of the angle of their pattern.
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
        // the rows are scaled: the inverse transpose maps a plane's normal
        t.m = vec4(r.g, 0.0) * rows / vec3(cone.w * cone.w, cone.w * cone.w, parallel ? 1.0 / (t.range * t.range) : 1.0);
        if (parallel ? any(greaterThan(abs(t.q.xy), vec2(1.0))) : t.q.z <= 0.0) return 1.0;
    }
#endif
    float side = shadow_layout.x, width = 2.0 / (side * cone.w);  // of a texel: metres, in a perspective tile at a distance of 1 m
    float line = floor((float(t.tile) + 0.5) / shadow_layout.y);  // in floats: integer division is slow on software renderers
    t.corner = vec2(float(t.tile) - line * shadow_layout.y, line) * side;
    t.texel = (((parallel ? t.q.xy : t.q.xy / t.q.z) * 0.5 + 0.5) * side);
    // On the plane m·q = k, -1/z is -m·(x, y, 1)/k at (x, y) = 2·texel/side - 1; in a parallel tile z is affine in x and y.
    vec3 m = parallel ? vec3(-t.m.xy / (abs(t.m.z) > 1e-6 ? t.m.z : 1e-6), 0.0) : t.m * (-1.0 / t.k);
    t.plane = vec3(m.xy * (2.0 / side), m.z - m.x - m.y);
    float steps = abs(t.plane.x) + abs(t.plane.y), bias = parallel ? width / t.range : width / t.q.z;
    t.own = parallel ? t.q.z : -1.0 / t.q.z;
    t.nearest = parallel ? t.own - 99.0 * bias : 2.0 * t.own;
    if (parallel) t.plane.z = t.own - dot(t.plane.xy, t.texel);
    float rounding = parallel ? ROUNDING : ROUNDING * shadow_layout.z / (t.q.z * max(abs(t.k), 1e-20));
    t.tolerance = BIAS * bias + r.rise * steps + rounding;
    t.beside = BESIDE * bias + 3.0 * steps + rounding;
    if (taps == 1)
    {
        // a flat receiver is seen by its texel, or the texel's centre lies past an edge of it: then the texel across the point's
        // quarter lies inside of an edge in either direction. Software renderers look up all three texels for all receivers; where
        // the first one decides, the others are the same one, since its place is in the processor's cache.
        float own = shadow_gap(t, vec2(0.0));
        bool decides = own >= (dot(r.n, r.g) > STRAIGHT ? -2.0 * t.tolerance : -t.beside);
        vec2 inward = decides ? vec2(0.0) : sign(fract(t.texel) - 0.5);
        // near a second edge, too: across a receiver that the light sees edge on
        if (shadow_gap(t, inward) < -t.beside) inward *= abs(t.plane.x) > abs(t.plane.y) ? vec2(1.0, 0.0) : vec2(0.0, 1.0);
        float next = shadow_gap(t, inward);
        return float(decides || next < -t.beside ? own <= t.tolerance : next <= rounding);
    }
#if SHADOW_RAYS || SHADOW_MARKS
    // If the four texels around the receiver all see its plane, it is lit. If they all see something before it, it is in shadow.
    // Else a ray decides, in a draw of its own: a loop makes the whole program slow on software renderers.
    vec4 gaps = vec4(shadow_gap(t, vec2(-0.5)), shadow_gap(t, vec2(0.5, -0.5)), shadow_gap(t, vec2(-0.5, 0.5)), shadow_gap(t, vec2(0.5)));
    bool lit = all(lessThanEqual(gaps, vec4(t.tolerance))) && all(greaterThanEqual(gaps, vec4(-t.beside)));
    bool dark = all(greaterThan(gaps, vec4(t.beside)));
#if SHADOW_MARKS
    vec4 known = vec4(greaterThanEqual(gaps, vec4(-t.beside))), free = known * vec4(lessThanEqual(gaps, vec4(t.tolerance)));
    undecided = undecided || !(lit || dark);
    return lit || dark ? float(lit) : dot(free, vec4(1.0)) / max(dot(known, vec4(1.0)), 1.0);
#else
    float seen = lit ? 1.0 : 0.0;
    bool open = !lit && !dark;
    while (open)  // a loop, since software renderers run an `if` for all pixels
    {
        seen = shadow_ray(i, r);
        open = false;
    }
    return seen;
#endif
#else
    // y: whether a texel sees the receiver. A texel whose centre lies beyond an edge of the receiver sees a surface far behind: in a
    // corner of two thin walls that is out of doors, although the one wall keeps the light from the other.
    mat2 turn = mat2(rotation.x, rotation.y, -rotation.y, rotation.x);
    vec2 lit = vec2(0.0);
    for (int s = 0; s < taps; ++s)
    {
        float gap = shadow_gap(t, turn * (vec2(s & 1, s >> 1) - 0.5));  // texels
        lit += gap >= -t.beside ? vec2(gap <= t.tolerance, 1.0) : vec2(0.0);
    }
    return lit.y > 0.0 ? lit.x / lit.y : 1.0;
#endif
}

// Unshadowed irradiance of light i at the receiver, and cosθ/d², m⁻²: the solid angle from the light of a square metre there.
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
    return min(color * cosine * strength, vec3(1e30));  // finite even where a light touches a surface
}

vec3 light_irradiance(int i, Receiver r)
{
    float spread;
    return light_irradiance(i, r, spread);
}

// The irradiance by light i.
vec3 irradiance_by(int i, Receiver r, int taps, vec2 rotation)
{
    vec3 E = light_irradiance(i, r);
    return E.r + E.g + E.b > 0.0 ? E * visibility(i, r, taps, rotation) : vec3(0.0);
}

// Direct irradiance E in W/m² with `taps` (1 or 4) shadow samples per light.
vec3 direct_irradiance(Receiver r, int taps, vec2 rotation)
{
    vec3 sum = vec3(0.0);
    // the first ones one by one: software renderers go through a loop once more than it has rounds
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
