// The pixels of a picture around one of them, each as a square, with a frame around all and around the one in the middle.
uniform sampler2D picture;
uniform ivec2 middle;   // the pixel in the middle
uniform ivec2 corner;   // of what is drawn, in the target, the lower left
uniform int zoom;       // pixels of the target, across and down, for one of the picture
uniform int count;      // pixels of the picture, across and down; odd

layout(location = 0) out vec4 out_color;

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy) - corner;
    ivec2 offset = at / zoom - count / 2;
    ivec2 inside = at - (at / zoom) * zoom;
    vec3 colour = texelFetch(picture, clamp(middle + offset, ivec2(0), textureSize(picture, 0) - 1), 0).rgb;
    bool rim = any(equal(at, ivec2(0))) || any(equal(at, ivec2(zoom * count - 1)));
    bool around = offset == ivec2(0) && (any(equal(inside, ivec2(0))) || any(equal(inside, ivec2(zoom - 1))));
    bool dark = dot(colour, vec3(1.0 / 3.0)) < 0.5;
    out_color = vec4(rim ? vec3(1.0) : around ? vec3(dark ? 1.0 : 0.0) : colour, 1.0);
}
