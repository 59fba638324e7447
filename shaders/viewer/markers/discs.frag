// An ellipse in its record's colour with dark sides, without its hidden parts.
uniform float width;         // half the width of the line, pixels
uniform sampler2D position;  // g-buffer; w depth along the view axis, 0 without a surface
uniform float pixel;         // size of a pixel at distance 1, in metres
uniform vec2 scale;          // pixels of the view per pixel of the target

flat in vec4 v_disc;         // the disc's normal, turned to the eye; w: its greater radius in metres
in vec3 v_position;
flat in vec3 v_color;
in float v_side;             // pixels from the middle of the line

layout(location = 0) out vec4 out_color;

// Share of a disc's radius that may lie behind the visible surface, since a tangent disc dips into a curved surface.
const float DIP = 0.05;

// The colour of the record, with dark sides, so that the line is visible on any ground.
vec4 line()
{
    float d = abs(v_side), core = clamp(1.25 - d, 0.0, 1.0);
    return vec4(v_color * core, mix(0.6 * clamp(width - d, 0.0, 1.0), 1.0, core));
}

void main()
{
    // A surface in front of the disc's plane hides the disc, and so does a surface nearer to the eye by more than the disc's
    // radius. A test of depths alone is not enough, see hidden.glsl. The test there is as good, but costs a software renderer
    // twice as much.
    vec4 q = texelFetch(position, ivec2(gl_FragCoord.xy * scale), 0);
    float slack = pixel * q.w + DIP * v_disc.w, depth = 1.0 / gl_FragCoord.w;
    if (q.w > 0.0 && (dot(q.xyz - v_position, v_disc.xyz) > slack || depth - q.w > v_disc.w + slack)) discard;
    out_color = line();
}
