// First step of the reduction: the sums over one block of a record's cell.
uniform sampler2D radiance;   // the atlas: rgb radiance, a distance (0: nothing hit)
uniform sampler2D table;      // one cell: direction in the record's frame, cosθ·dω
uniform sampler2D geometric;  // texel (i, 0): record i's geometric normal in its frame
uniform ivec2 cell;           // texels of a cell
uniform ivec2 block;          // texels of a block
uniform int columns;          // cells per row
uniform vec3 sky;             // radiance where nothing was hit

layout(location = 0) out vec4 out_sums;   // Σ L·cosθ·dω, Σ cosθ·dω / r
layout(location = 1) out vec2 out_share;  // Σ cosθ·dω

void main()
{
    ivec2 corner = ivec2(gl_FragCoord.xy) * block;
    ivec2 place = corner / cell, inside = corner - place * cell;
    vec3 g = texelFetch(geometric, ivec2(place.y * columns + place.x, 0), 0).xyz;
    out_sums = vec4(0.0);
    out_share = vec2(0.0);
    for (int y = 0; y < block.y; ++y)
        for (int x = 0; x < block.x; ++x)
        {
            vec4 direction = texelFetch(table, inside + ivec2(x, y), 0);
            vec4 seen = texelFetch(radiance, corner + ivec2(x, y), 0);
            if (dot(direction.xyz, g) <= 0.0) continue;  // below the surface itself
            vec3 L = seen.a > 0.0 ? seen.rgb : sky;
            out_sums += direction.w * vec4(L, seen.a > 0.0 ? 1.0 / seen.a : 0.0);
            out_share.x += direction.w;
        }
}
