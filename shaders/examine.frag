// Where records are missing: of each tile of the screen, the pixel that is served worst (Jones 2010, section 2.3).
uniform sampler2D position;  // g-buffer
uniform sampler2D normal;
uniform sampler2D albedo;
uniform sampler2D weight;    // Σ of raw w
uniform int side;            // pixels of a tile
uniform float tolerance;     // Σw below which a pixel asks for a record
uniform int seed;

layout(location = 0) out vec4 out_position;  // of the worst pixel; w: how many pixels of the tile ask
layout(location = 1) out vec4 out_normal;    // its shading normal, geometric normal octahedral .x
layout(location = 2) out vec4 out_rest;      // geometric normal octahedral .y, its Σw, pixels of the tile that see anything

// A random number below 1 from a pixel (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering": pcg).
float random(ivec2 pixel)
{
    uint v = uint(pixel.x) + uint(pixel.y) * 16384u + uint(seed) * 268435399u;
    v = v * 747796405u + 2891336453u;
    v = ((v >> ((v >> 28u) + 4u)) ^ v) * 277803737u;
    return float(((v >> 22u) ^ v) >> 8) / 16777216.0;
}

void main()
{
    ivec2 corner = ivec2(gl_FragCoord.xy) * side, size = textureSize(weight, 0);
    ivec2 worst = corner;
    float least = 1e30, priority = 2.0;
    int asking = 0, seen = 0;
    for (int y = corner.y; y < min(corner.y + side, size.y); ++y)
        for (int x = corner.x; x < min(corner.x + side, size.x); ++x)
        {
            float w = texelFetch(weight, ivec2(x, y), 0).r;
            if (texelFetch(position, ivec2(x, y), 0).w == 0.0) continue;
            ++seen;
            if (w >= tolerance) continue;
            ++asking;
            float chance = random(ivec2(x, y));
            if (w < least || (w == least && chance < priority))
            {
                worst = ivec2(x, y);
                least = w;
                priority = chance;
            }
        }
    vec4 n = texelFetch(normal, worst, 0);
    out_position = vec4(texelFetch(position, worst, 0).xyz, float(asking));
    out_normal = n;
    out_rest = vec4(texelFetch(albedo, worst, 0).w, least, float(seen), 0.0);
}
