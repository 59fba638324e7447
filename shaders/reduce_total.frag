// Last step of the reduction: a record's blocks become its irradiance and its harmonic mean distance.
uniform sampler2D sums;
uniform sampler2D share;
uniform ivec2 blocks;      // per cell
uniform int columns;       // cells per row
uniform int first;         // number of the batch's first record in the cache
uniform int count;
uniform int record_columns;
uniform float diagonal;    // metres: the greatest radius there is

layout(location = 0) out vec4 out_record;  // E in W/m², R_k in metres

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    int i = texel.y * record_columns + texel.x - first;
    if (i < 0 || i >= count) discard;
    ivec2 corner = ivec2(i % columns, i / columns) * blocks;
    vec4 total = vec4(0.0);
    float solid = 0.0;
    for (int y = 0; y < blocks.y; ++y)
        for (int x = 0; x < blocks.x; ++x)
        {
            total += texelFetch(sums, corner + ivec2(x, y), 0);
            solid += texelFetch(share, corner + ivec2(x, y), 0).x;
        }
    // Ward et al. 1988: R = Σ cosθ·dω / Σ (cosθ·dω / r)
    out_record = vec4(total.rgb, total.a * diagonal > solid ? solid / total.a : diagonal);
}
