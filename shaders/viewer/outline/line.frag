// A bright line around a silhouette, with a dark seam on its outer side.

uniform sampler2D silhouette;
uniform int width;  // pixels

layout(location = 0) out vec4 out_color;

const vec4 LINE = vec4(1.0, 0.72, 0.25, 1.0), SEAM = vec4(0.0, 0.0, 0.0, 0.65);

// Whether any pixel at about this distance is inside.
bool inside_at(ivec2 pixel, int distance)
{
    ivec2 last = textureSize(silhouette, 0) - 1;
    int slant = (7 * distance + 5) / 10;
    bool found = false;
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            ivec2 step = ivec2(x, y) * (x * y == 0 ? distance : slant);
            found = found || texelFetch(silhouette, clamp(pixel + step, ivec2(0), last), 0).r > 0.5;
        }
    }
    return found;
}

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    if (texelFetch(silhouette, pixel, 0).r > 0.5) discard;
    if (inside_at(pixel, width) || inside_at(pixel, 1)) out_color = LINE;
    else if (inside_at(pixel, 2 * width)) out_color = SEAM;
    else discard;
}
