// How far a tile of the screen sees: what lies farther from the eye is hidden there.
uniform sampler2D position;  // g-buffer
uniform vec3 eye;

layout(location = 0) out float out_distance;  // metres, 0 where nothing is seen

void main()
{
    const int side = SIDE;  // pixels of a tile
    ivec2 corner = ivec2(gl_FragCoord.xy) * side, size = textureSize(position, 0);
    float farthest = 0.0;
    for (int i = 0; i < side * side; ++i)
    {
        ivec2 pixel = min(corner + ivec2(i % side, i / side), size - 1);
        vec4 p = texelFetch(position, pixel, 0);
        farthest = p.w > 0.0 ? max(farthest, length(p.xyz - eye)) : farthest;
    }
    out_distance = farthest;
}
