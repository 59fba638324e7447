// One texel of a texture, for a target of one pixel.
uniform sampler2D values;
uniform ivec2 place;

layout(location = 0) out vec4 out_texel;

void main()
{
    out_texel = texelFetch(values, place, 0);
}
