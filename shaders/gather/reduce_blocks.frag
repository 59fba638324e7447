// First step of the reduction: a fragment sums the texels of one block of a record's cell (Jones 2010, 2.1;
// METHOD.md, 3.5, 4.2, 4.4).
#include "generated/constants.glsl"
#include "gather/close_hits.glsl"
#include "gather/places.glsl"
#include "lib/texel.glsl"
#include "lighting/sky.glsl"

uniform sampler2D radiance;  // the atlas: rgb radiance, W/(m² sr); a distance, metres (0: no hit)
uniform sampler2D planes;    // the atlas: plane of the hit; dot(xyz, ω) is 1/distance in the unit direction ω, metres⁻¹ (0: no
                             // hit); w: -1 on the inner side of a closed mesh, else the pair of close_hits.glsl
uniform sampler2D table;     // one cell: mean direction of the texel in the record's frame, cosθ·dω
uniform sampler2D rays;      // one cell: direction of the texel's ray in the record's frame, cosθ·dω
#if SKY_SHARE
uniform sampler2D sky_share;  // the atlas: visible share of the sky per texel; without this texture, it is 1 if the ray hits nothing
#endif
uniform sampler2D edges;     // two per texel: edge vector e to the right and the upper neighbour, and number of the neighbour
uniform sampler2D frames;    // texels (i, 0..2): tangent, bitangent, normal at eye i; (i, 3): geometric normal in this frame
uniform ivec2 cell;          // size of a cell, texels
uniform ivec2 block;         // size of a block, texels
uniform int columns;         // cells per row

layout(location = 0) out vec4 out_sums;   // Σ L·cosθ·dω, Σ cosθ·dω / r
layout(location = 1) out vec4 out_share;  // Σ cosθ·dω; Σ cosθ·dω of inner sides of closed meshes; of close values of the surface
                                          // cache Σ Y·cosθ·dω (Y: luminance of their light) and Σ ν·ρ·cosθ·dω/π
#if GRADIENTS
layout(location = 2) out vec4 out_m_r;    // M = Σ L·ω·dω of red, green and blue, in the record's frame; w: second
                                          // derivatives xx, xy, yy of the luminance of E, W/m⁴
layout(location = 3) out vec4 out_m_g;
layout(location = 4) out vec4 out_m_b;
layout(location = 5) out vec4 out_g_r;    // ∇E of red, green and blue, in the record's frame, W/m³
layout(location = 6) out vec4 out_g_g;
layout(location = 7) out vec4 out_g_b;    // w: sum of squared differences of c·Y between neighbouring texels, for the noise
#endif

// Return radiance and 1/distance at a texel of the cell whose first texel is `corner`. direction: the texel's entry in `table`.
vec4 incident_radiance(ivec2 corner, ivec2 texel, vec4 direction, SkyFrame axes)
{
    vec4 s = texel_at(radiance, corner + texel);
#if SKY_MAP
    // the ray's direction, not the stratum's mean: near the horizon, the sky changes within a stratum
    direction = texel_at(rays, texel);
#endif
#if SKY_SHARE
    float visible_sky = texel_at(sky_share, corner + texel).r;
#else
    float visible_sky = s.a > 0.0 ? 0.0 : 1.0;
#endif
    vec3 sky_light = visible_sky * sky_along(direction, axes);
    return s.a > 0.0 ? vec4(s.rgb + sky_light, 1.0 / s.a) : vec4(sky_light, 0.0);
}

// Read the frame of an eye, the geometric normal in this frame, and the orientation of the sky. eye: column of `frames`.
void read_eye(int eye, out mat3 frame, out vec3 g, out SkyFrame axes)
{
    frame = mat3(texel_at(frames, ivec2(eye, 0)).xyz, texel_at(frames, ivec2(eye, 1)).xyz,
                 texel_at(frames, ivec2(eye, 2)).xyz);
    g = texel_at(frames, ivec2(eye, 3)).xyz;
    axes = sky_frame(frame);
}

// Return 1 if the ray of a texel lies above the horizon of the surface, else 0. A ray below it hits the surface itself, which may
// be far brighter than its surroundings, although the mean direction of the stratum lies above.
float above_horizon(ivec2 texel, vec3 g)
{
    return dot(texel_at(rays, texel).xyz, g) > 0.0 ? 1.0 : 0.0;
}

void main()
{
    ivec2 first = ivec2(gl_FragCoord.xy) * block;
    ivec2 index = first / cell, corner = index * cell, inside = first - corner;
    out_sums = vec4(0.0);
    out_share = vec4(0.0);
    int record = index.y * columns + index.x;
    mat3 frame;
    vec3 g;
    SkyFrame axes;
    read_eye(place_of_texel(record, ivec2(0)), frame, g, axes);
#if GRADIENTS
    mat3 M = mat3(0.0), G = mat3(0.0);
    vec3 H = vec3(0.0);
    float squares = 0.0;
#endif
    for (int y = inside.y; y < inside.y + block.y; ++y)
    {
#if GRADIENTS
        vec4 next = texel_at(table, ivec2(inside.x, y)), L_next = incident_radiance(corner, ivec2(inside.x, y), next, axes);
        vec4 plane_next = texel_at(planes, corner + ivec2(inside.x, y));
#endif
        for (int x = inside.x; x < inside.x + block.x; ++x)
        {
#if GRADIENTS
            vec4 direction = next, L = L_next, plane = plane_next;
#else
            read_eye(place_of_texel(record, ivec2(x, y)), frame, g, axes);
            vec4 direction = texel_at(table, ivec2(x, y)), L = incident_radiance(corner, ivec2(x, y), direction, axes);
            vec4 plane = texel_at(planes, corner + ivec2(x, y));
#endif
            float above = above_horizon(ivec2(x, y), g);
            direction.w *= above;
            out_sums += direction.w * vec4(L.rgb, L.a);
            vec2 close = unpack_pair(max(plane.w, 0.0)) * vec2(dot(L.rgb, LUMINANCE), 1.0 / PI);
            out_share += direction.w * vec4(1.0, plane.w < 0.0 ? 1.0 : 0.0, close);
#if GRADIENTS
            M += outerProduct(direction.xyz * (direction.w / direction.z), L.rgb);
            for (int j = 0; j < 2; ++j)
            {
                vec4 edge = texel_at(edges, ivec2(2 * x + j, y));
                int number = int(edge.w);  // without a neighbour the number of the texel itself, so that the difference is 0
                ivec2 b = ivec2(number % NEIGHBOUR_STRIDE, number / NEIGHBOUR_STRIDE);
                vec4 neighbour = texel_at(table, b);
                vec4 L_b = incident_radiance(corner, b, neighbour, axes), plane_b = texel_at(planes, corner + b);
                if (j == 0)
                {
                    // in a block, the right neighbour is the next texel
                    next = neighbour;
                    L_next = L_b;
                    plane_next = plane_b;
                }
                vec3 w = normalize(direction.xyz + neighbour.xyz), w_world = frame * w;
                // 1/r of the nearer plane at the edge (METHOD.md, 4.3): at grazing angles unlike 1/r at the texel's centre
                float nearer = max(dot(plane.xyz, w_world), dot(plane_b.xyz, w_world));
                nearer = above * above_horizon(b, g) * clamp(nearer, 0.0, max(L.a, L_b.a));
                G += outerProduct(edge.xyz * nearer, L_b.rgb - L.rgb);
                float difference = direction.w * dot(L_b.rgb - L.rgb, LUMINANCE);
                squares += difference * difference;
                // edge form of the Hessian, 4/r²·ΔY·sym(e ⊗ ω): symmetric part of the gradient's derivative (METHOD.md, 4.4)
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
    out_g_b = vec4(G[2], squares);
#endif
}
