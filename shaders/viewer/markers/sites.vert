// A site of the surface cache as a dot of constant size, where the camera sees its side.
#include "generated/constants.glsl"
#include "lib/display.glsl"
#include "lib/table.glsl"
#include "viewer/markers/hidden.glsl"

uniform sampler2D records_position;
uniform sampler2D records_normal;
uniform sampler2D surface_values;  // rgb E in W/m²
uniform int first;                 // number of the first site
uniform mat4 clip_from_world;
uniform vec3 eye;
uniform vec2 size;     // of the target in pixels
uniform float gain;    // the exposure as a factor
uniform float radius;  // pixels

flat out vec3 v_color;
out vec2 v_at;  // pixels from the centre

void main()
{
    int number = first + gl_InstanceID;
    ivec2 texel = table_texel(number);
    vec3 p = texelFetch(records_position, texel, 0).xyz;
    vec4 clip = clip_from_world * vec4(p, 1.0);
    v_color = display(texelFetch(surface_values, texel, 0).rgb * INV_PI * gain);
    v_at = (vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0) * (radius + 1.0);
    vec2 at = (clip.xy / clip.w * 0.5 + 0.5) * vec2(textureSize(position, 0));
    bool lost = clip.w <= 0.0 || any(greaterThan(abs(clip.xy), vec2(1.05 * clip.w))) || hidden(p, ivec2(floor(at))) ||
                dot(texelFetch(records_normal, texel, 0).xyz, eye - p) <= 0.0;
    gl_Position = lost ? vec4(0.0, 0.0, 2.0, 1.0) : vec4(clip.xy + v_at * 2.0 / size * clip.w, clip.zw);
}
