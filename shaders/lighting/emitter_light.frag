// The irradiance that comes straight from emitters at every pixel, by shadow rays to points of them.
//
// For each shadow ray a few emitters are looked at, and one of them is taken, in proportion to the light that it would bring if nothing
// stood before it (resampled importance sampling, Talbot et al. 2005); then a point of it, evenly by the solid angle that it takes up
// (Arvo 1995), so that it makes no noise that an emitter is near.
#include "lighting/emitter_sample.glsl"
#include "lib/rays/bvh.glsl"
#include "lib/octahedral.glsl"

uniform sampler2D position;    // g-buffer
uniform sampler2D normal;
uniform sampler2D lit_normal;  // bent by the normal map
uniform sampler2D albedo;
uniform ivec2 picture_corner;  // the pixel of the whole picture that is the first one here
uniform float offset;          // metres above the surface from which shadow rays start
uniform int first;             // number of the first sample of this draw
uniform int count;             // of its samples; emitter_samples are those of all draws
uniform int candidates;        // emitters that are looked at for a shadow ray
uniform int seed;

layout(location = 0) out vec4 out_irradiance;  // W/m²

const float SMALL = 2e-3;     // steradians below which a triangle's points are spread evenly by area, since angles would be rounding
const float LEAST_COSINE = 0.05;  // with which an emitter at the horizon is taken into account, since it may reach above it

// From sample to sample these are added, as fractions of 2³², which is exact however far it goes: √2 and √13 for the emitter, and for the
// point of it the lattice of Roberts (2018).
const uvec4 STEPS = uvec4(1779033705u, 1300411463u, 3242174889u, 2447445415u);
// And these from pixel to pixel along a Z-shaped curve, √5, √2, √13 and √3: small blocks of pixels share the unit cube evenly, so that
// noise is fine-grained (after Ahmed and Wonka 2020).
const uvec4 SHIFTS = uvec4(2654435769u, 1779033705u, 1300411463u, 3144134279u);

// The bits of x and y by turns.
uint along_curve(uvec2 at)
{
    at = (at | (at << 8u)) & 0x00FF00FFu;
    at = (at | (at << 4u)) & 0x0F0F0F0Fu;
    at = (at | (at << 2u)) & 0x33333333u;
    at = (at | (at << 1u)) & 0x55555555u;
    return at.x | (at.y << 1u);
}

// Four numbers, 0..1, of a sample.
vec4 random(uint pixel, uint number)
{
    return vec4((pixel * SHIFTS + number * STEPS + uint(seed) * uvec4(2654435769u, 2246822519u, 3266489917u, 668265263u)) >> 8u) / 16777216.0;
}

// A triangle, its corners relative to the eye.
struct Corners
{
    vec3 a;
    vec3 b;
    vec3 c;
};

Corners corners_of(int triangle, vec3 eye)
{
    return Corners(triangle_point(triangle, 0) - eye, triangle_point(triangle, 1) - eye, triangle_point(triangle, 2) - eye);
}

// The steradians that it takes up (Van Oosterom and Strackee 1983); volume: that of the three corners, of any sign.
float solid_angle(Corners at, float volume)
{
    float a = length(at.a), b = length(at.b), c = length(at.c);
    float angle = 2.0 * atan(abs(volume), a * b * c + dot(at.a, at.b) * c + dot(at.b, at.c) * a + dot(at.c, at.a) * b);
    return angle < 0.0 ? angle + 2.0 * PI : angle;
}

// The part of v that is at right angles to the unit vector w, made unit.
vec3 across(vec3 v, vec3 w)
{
    return normalize(v - dot(v, w) * w);
}

float angle_between(vec3 a, vec3 b)
{
    return dot(a, b) < 0.0 ? PI - 2.0 * asin(min(0.5 * length(a + b), 1.0)) : 2.0 * asin(min(0.5 * length(a - b), 1.0));
}

// A direction into the triangle with corners in the unit directions a, b and c: evenly by solid angle where u is even in the unit square.
vec3 direction_into(vec3 a, vec3 b, vec3 c, vec2 u)
{
    vec3 ab = normalize(cross(a, b)), bc = normalize(cross(b, c)), ca = normalize(cross(c, a));
    float alpha = angle_between(ab, -ca), beta = angle_between(bc, -ab), gamma = angle_between(ca, -bc);
    // the share u.x of the area is that of a triangle with the same a and b, whose third corner lies between c and a
    float phi = u.x * (alpha + beta + gamma - PI) + PI - alpha;
    float s = sin(phi), t = cos(phi), cos_alpha = cos(alpha), sin_alpha = sin(alpha), cos_c = dot(a, b);
    // sin and cos of that triangle's area plus π, less alpha: k1, k2 as in Arvo's paper
    float k1 = t + cos_alpha, k2 = s - sin_alpha * cos_c;
    float q = (k2 + (k2 * t - k1 * s) * cos_alpha) / ((k2 * s + k1 * t) * sin_alpha);
    q = clamp(q, -1.0, 1.0);
    vec3 third = q * a + sqrt(max(1.0 - q * q, 0.0)) * across(c, a);
    float z = 1.0 - u.y * (1.0 - dot(third, b));
    return z * b + sqrt(max(1.0 - z * z, 0.0)) * across(third, b);
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 p = texelFetch(position, pixel, 0), about = texelFetch(normal, pixel, 0);
    vec3 n = texelFetch(lit_normal, pixel, 0).xyz, g = octahedral_decode(vec2(about.w, texelFetch(albedo, pixel, 0).w));
    vec3 eye = p.xyz + offset * g, E = vec3(0.0);
    float all = all_importance(eye);
    int samples = p.w > 0.0 ? count : 0;
    uint curve = along_curve(uvec2(pixel + picture_corner));
    for (int s = 0; s < samples; ++s)
    {
        vec4 u = random(curve, uint(first + s));
        Emitter chosen;
        float sum = 0.0, height = 1.0, omega = 0.0;  // of the candidates; the cosine and the solid angle of the chosen one
        for (int k = 0; k < candidates; ++k)
        {
            Emitter one = choose_emitter((float(k) + u.x) / float(candidates) * all, eye);
            Corners at = corners_of(one.triangle, eye);
            vec3 way = at.a + at.b + at.c, area = cross(at.b - at.a, at.c - at.a);
            float volume = dot(at.a, area);
            // the cosine with which its light falls in, about; all of it lies below the horizon where its corners do
            float highest = max(dot(n, at.a) / length(at.a), max(dot(n, at.b) / length(at.b), dot(n, at.c) / length(at.c)));
            bool above = highest > 0.0 && max(dot(g, at.a), max(dot(g, at.b), dot(g, at.c))) > 0.0;
            bool possible = above && !(one.one_sided && volume > 0.0);
            highest = max(max(highest, dot(n, way) / length(way)), LEAST_COSINE);
            float taken = solid_angle(at, volume);
            // the light that it would bring over the probability with which it is looked at; both go by its luminance
            float distance2 = emitter_clusters[2 * one.cluster + 1].x / one.importance;
            float w = possible ? highest * taken * distance2 / max(0.5 * length(area), 1e-30) : 0.0;
            sum += w;
            float share = sum > 0.0 ? w / sum : 0.0;
            bool take = u.y < share;
            u.y = take ? u.y / share : (u.y - share) / max(1.0 - share, 1e-6);
            if (take)
            {
                chosen = one;
                height = highest;
                omega = taken;
            }
        }
        if (sum <= 0.0) continue;

        Corners at = corners_of(chosen.triangle, eye);
        vec3 share = even_point(u.z, u.w);
        if (omega >= SMALL)
        {
            vec3 d = direction_into(normalize(at.a), normalize(at.b), normalize(at.c), u.zw);
            vec3 volumes = vec3(dot(d, cross(at.b, at.c)), dot(d, cross(at.c, at.a)), dot(d, cross(at.a, at.b)));
            share = max(volumes * sign(volumes.x + volumes.y + volumes.z), 0.0);
            share /= share.x + share.y + share.z;
        }
        vec3 away = share.x * at.a + share.y * at.b + share.z * at.c, area = 0.5 * cross(at.b - at.a, at.c - at.a);
        float r = length(away), cosine = dot(n, away) / r;
        // of the solid angle, what one of its points stands for
        float taken = omega >= SMALL ? omega : abs(dot(area, away)) / (r * r * r);
        bool possible = cosine > 0.0 && dot(g, away) > 0.0 && taken > 0.0;
        if (!bvh_way_free(eye, away, r, possible)) continue;
        float luminance = chosen.density * emitter_clusters[2 * chosen.cluster + 1].x;
        vec3 L = emitter_radiance(chosen.triangle, share, length(area) / (16.0 * emitter_samples));
        E += L * (cosine * taken * sum * all / (float(candidates) * luminance * omega * height));
    }
    out_irradiance = vec4(E / emitter_samples, 0.0);
}
