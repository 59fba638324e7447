// Texels of a texture at several places, for a target of one row.
uniform sampler2D values;
uniform sampler2D places;  // a texel each: pixels from the upper left

layout(location = 0) out vec4 out_texel;

void main()
{
    ivec2 place = ivec2(texelFetch(places, ivec2(int(gl_FragCoord.x), 0), 0).xy);
    out_texel = texelFetch(values, ivec2(place.x, textureSize(values, 0).y - 1 - place.y), 0);
}
