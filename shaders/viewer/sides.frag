// What a view sees at the places of a coarse grid: 0 nothing, 1 the front of a triangle, 2 the back of one.
#include "lib/surface.glsl"

uniform sampler2D position;  // g-buffer
uniform sampler2D emission;
uniform vec3 eye;
uniform ivec2 grid;

layout(location = 0) out float out_side;

void main()
{
    ivec2 texel = ivec2((gl_FragCoord.xy) / vec2(grid) * vec2(textureSize(position, 0)));
    vec4 seen = texelFetch(position, texel, 0);
    vec4 plane = face_plane(int(texelFetch(emission, texel, 0).w));
    out_side = seen.w == 0.0 ? 0.0 : dot(plane.xyz, eye) >= plane.w ? 1.0 : 2.0;
}
