// A layer of markers, whose colours are multiplied by alpha.
uniform sampler2D layer;

layout(location = 0) out vec4 out_color;

void main()
{
    out_color = texelFetch(layer, ivec2(gl_FragCoord.xy), 0);
}
