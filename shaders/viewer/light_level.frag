// Light at the pixels of a lattice over the view: its weighted sum, and whether anything is seen there.
uniform sampler2D position;  // g-buffer
uniform sampler2D sums;      // Σ k·E and Σ k
uniform sampler2D direct;    // direct irradiance
uniform vec3 weights;        // of red, green and blue
uniform vec2 lattice;        // columns and rows

layout(location = 0) out vec4 out_light;

void main()
{
    vec2 size = vec2(textureSize(position, 0));
    ivec2 pixel = ivec2(gl_FragCoord.xy * size / lattice);
    vec4 s = texelFetch(sums, pixel, 0);
    vec3 E = texelFetch(direct, pixel, 0).rgb + s.rgb / (s.a > 0.0 ? s.a : 1.0);
    out_light = vec4(dot(E, weights), texelFetch(position, pixel, 0).w > 0.0 ? 1.0 : 0.0, 0.0, 0.0);
}
