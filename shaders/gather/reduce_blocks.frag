// First step of the reduction: the sums over one block of a record's cell.
#include "generated/constants.glsl"
#include "gather/close_hits.glsl"
#include "gather/places.glsl"
#include "lib/texel.glsl"
#include "lighting/sky.glsl"

uniform sampler2D radiance;  // the atlas: rgb radiance, a distance (0: nothing hit)
uniform sampler2D planes;    // plane of the hit: dot(xyz, w) is 1/distance in the unit direction w (0: nothing hit); w: -1 on
                             // the inner side of a closed mesh, else the pair of close_hits.glsl
uniform sampler2D table;     // one cell: direction in the record's frame, cosθ·dω
#if SKY_MAP
uniform sampler2D rays;      // one cell: direction of each texel's ray in the record's frame, cosθ·dω
#endif
#if SKY_SHARE
uniform sampler2D sky_share;  // the atlas: the share of a texel that sees the sky; else its own ray decides
#endif
uniform sampler2D edges;     // two texels a texel: the edges to its right and upper neighbours, and which those are
uniform sampler2D frames;    // texels (i, 0..2): the frame at place i, (i, 3): the geometric normal in it
uniform ivec2 cell;          // texels of a cell
uniform ivec2 block;         // texels of a block
uniform int columns;         // cells per row

layout(location = 0) out vec4 out_sums;   // Σ L·cosθ·dω, Σ cosθ·dω / r
layout(location = 1) out vec4 out_share;  // Σ cosθ·dω; that of inner sides of closed meshes; of close values of the surface
                                          // cache Σ Y·cosθ·dω, Y their luminance, and Σ ρ·cosθ·dω/π
#if GRADIENTS
layout(location = 2) out vec4 out_m_r;    // Σ L·ω·dω of red, green and blue, in the record's frame; w: the luminance's
                                          // second derivatives xx, xy, yy there
layout(location = 3) out vec4 out_m_g;
layout(location = 4) out vec4 out_m_b;
layout(location = 5) out vec4 out_g_r;    // ∇E of red, green and blue, in the record's frame
layout(location = 6) out vec4 out_g_g;
layout(location = 7) out vec4 out_g_b;    // w: squared steps of the luminance's terms from texel to texel
#endif

// Radiance and 1/distance at a texel of the cell whose first texel is `corner`; direction: the texel's entry in the table.
vec4 seen(ivec2 corner, ivec2 texel, vec4 direction, SkyFrame sky_there)
{
    vec4 s = texel_at(radiance, corner + texel);
#if SKY_MAP
    // a stratum at the horizon is brightest for a record at its upper end, not in its mean direction
    direction = texel_at(rays, texel);
#endif
#if SKY_SHARE
    float share = texel_at(sky_share, corner + texel).r;
#else
    float share = s.a > 0.0 ? 0.0 : 1.0;
#endif
    vec3 sky_light = share * sky_along(direction, sky_there);
    return s.a > 0.0 ? vec4(s.rgb + sky_light, 1.0 / s.a) : vec4(sky_light, 0.0);
}

// Frame, geometric normal in it and sky at an eye position of a record.
void read_eye(int place, out mat3 frame, out vec3 g, out SkyFrame sky_there)
{
    frame = mat3(texel_at(frames, ivec2(place, 0)).xyz, texel_at(frames, ivec2(place, 1)).xyz,
                 texel_at(frames, ivec2(place, 2)).xyz);
    g = texel_at(frames, ivec2(place, 3)).xyz;
    sky_there = sky_frame(frame);
}

void main()
{
    ivec2 first = ivec2(gl_FragCoord.xy) * block;
    ivec2 place = first / cell, corner = place * cell, inside = first - corner;
    out_sums = vec4(0.0);
    out_share = vec4(0.0);
    int record = place.y * columns + place.x;
    mat3 frame;
    vec3 g;
    SkyFrame sky_there;
    read_eye(place_of_texel(record, ivec2(0)), frame, g, sky_there);
#if GRADIENTS
    mat3 M = mat3(0.0), G = mat3(0.0);
    vec3 H = vec3(0.0);
    float steps = 0.0;
#endif
    for (int y = inside.y; y < inside.y + block.y; ++y)
    {
#if GRADIENTS
        vec4 after = texel_at(table, ivec2(inside.x, y)), L_after = seen(corner, ivec2(inside.x, y), after, sky_there);
        vec4 plane_after = texel_at(planes, corner + ivec2(inside.x, y));
#endif
        for (int x = inside.x; x < inside.x + block.x; ++x)
        {
#if GRADIENTS
            vec4 direction = after, L = L_after, own = plane_after;
#else
            read_eye(place_of_texel(record, ivec2(x, y)), frame, g, sky_there);
            vec4 direction = texel_at(table, ivec2(x, y)), L = seen(corner, ivec2(x, y), direction, sky_there);
            vec4 own = texel_at(planes, corner + ivec2(x, y));
#endif
            float above = dot(direction.xyz, g) > 0.0 ? 1.0 : 0.0;  // 0: below the surface itself
            direction.w *= above;
            out_sums += direction.w * vec4(L.rgb, L.a);
            vec2 close = parted(max(own.w, 0.0)) * vec2(dot(L.rgb, LUMINANCE), 1.0 / PI);
            out_share += direction.w * vec4(1.0, own.w < 0.0 ? 1.0 : 0.0, close);
#if GRADIENTS
            M += outerProduct(direction.xyz * (direction.w / direction.z), L.rgb);
            for (int j = 0; j < 2; ++j)
            {
                vec4 edge = texel_at(edges, ivec2(2 * x + j, y));
                int number = int(edge.w);  // no neighbour: the texel itself, and a difference of 0
                ivec2 b = ivec2(number % NEIGHBOUR_STRIDE, number / NEIGHBOUR_STRIDE);
                vec4 beside = texel_at(table, b);
                vec4 L_b = seen(corner, b, beside, sky_there), plane_b = texel_at(planes, corner + b);
                if (j == 0)
                {
                    // in a block, the right neighbour is the next texel
                    after = beside;
                    L_after = L_b;
                    plane_after = plane_b;
                }
                vec3 w = normalize(direction.xyz + beside.xyz), w_world = frame * w;
                // how near the nearer of the two is where they meet: seen at a low angle, much farther than in the texel's middle
                float nearer = max(dot(own.xyz, w_world), dot(plane_b.xyz, w_world));
                nearer = above * clamp(nearer, 0.0, max(L.a, L_b.a));
                G += outerProduct(edge.xyz * nearer, L_b.rgb - L.rgb);
                float rise = direction.w * dot(L_b.rgb - L.rgb, LUMINANCE);
                steps += rise * rise;
                // an edge slides by δ/r, and as it comes nearer, faster: the gradient's own derivative (symmetric, as a Hessian is)
                H += 4.0 * nearer * nearer * dot(L_b.rgb - L.rgb, LUMINANCE)
                     * vec3(edge.x * w.x, 0.5 * (edge.x * w.y + edge.y * w.x), edge.y * w.y);
            }
#endif
        }
    }
#if GRADIENTS
    out_m_r = vec4(M[0], H.x);
    out_m_g = vec4(M[1], H.y);
    out_m_b = vec4(M[2], H.z);
    out_g_r = vec4(G[0], 0.0);
    out_g_g = vec4(G[1], 0.0);
    out_g_b = vec4(G[2], steps);
#endif
}
