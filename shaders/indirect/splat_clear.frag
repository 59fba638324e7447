// An empty splat buffer: no sums, and no weight wanted where nothing is seen.
uniform sampler2D position;  // g-buffer
uniform int every;           // of its pixels

layout(location = 0) out vec4 out_sums;
layout(location = 1) out vec2 out_weight;

void main()
{
    out_sums = vec4(0.0);
    out_weight = vec2(texelFetch(position, every * ivec2(gl_FragCoord.xy), 0).w > 0.0 ? 0.0 : NOTHING_SEEN, 0.0);
}
