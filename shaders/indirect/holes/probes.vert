// Probes of earlier ticks in the cells of a view (METHOD.md, 8.2). A point is a probe.
#include "generated/record_columns.glsl"
#include "lib/table.glsl"

uniform int first;  // number of the first probe
uniform mat4 clip_from_world;
uniform vec2 cells;  // width and height of the picture in cells, with fractions
uniform ivec2 grid;  // columns and rows of cells

flat out vec3 v_position;  // world space, metres
flat out vec3 v_normal;
flat out vec4 v_light;     // irradiance in W/m², and R in metres

void main()
{
    ivec2 texel = table_texel(first + gl_VertexID);
    v_position = record_position(texel);
    v_normal = record_normal(texel);
    v_light = vec4(record_irradiance(texel), record_radius(texel));
    vec4 clip = clip_from_world * vec4(v_position, 1.0);
    vec2 cell = (0.5 * clip.xy / clip.w + 0.5) * cells;
    gl_Position = clip.w > 0.0 ? vec4(2.0 * cell / vec2(grid) - 1.0, 0.0, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);
}
