// Splat of a record: a quad that bounds the record's sphere of influence on screen (Jones 2010, figure 1; METHOD.md, 6.1). An
// instance is a record.
#include "indirect/splat_depth.glsl"
#include "indirect/splat_outputs.glsl"
#include "lib/normals.glsl"

in int in_number;          // number of the record

uniform mat4 clip_from_world;
uniform vec3 forward;      // unit, the view axis
uniform float pixel;       // size of a pixel at distance 1, metres

const float OWN_PIXEL = 0.75;  // pixels: radius of an enclosed record, which covers only its own pixel

void main()
{
    ivec2 texel = table_texel(in_number);
    vec3 p = record_position(texel);

    vec3 to_eye = eye - p;
    float d = length(to_eye);
    float trust;
    Ellipse ellipse = view_ellipse(texel, d, trust);
    if (record_enclosed(texel)) ellipse.along = ellipse.across = OWN_PIXEL * pixel * d;
    float r = ellipse.along;
    pass_record(texel, ellipse, trust);

    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    r *= 1.0 + 1e-5;  // rounding must not cut off the rim
    if (d <= r)
    {
        gl_Position = vec4(corner, -1.0, 1.0);  // with the eye in the sphere, the quad covers the screen
        return;
    }
    float reach = r;  // extent along the view axis, metres
    // a half size of r·d/√(d² - r²), in the plane through the centre that faces the eye, bounds the silhouette
    vec3 axis = to_eye / d;
    vec3 u = perpendicular(axis);
    vec2 half_size = vec2(r * d / sqrt(d * d - r * r));
    if (hessian)
    {
        // Only a slab of the ellipsoid passes the in-front test: with x = |p - p_k|/R, y = √(1 - n·n_k) and x + y < a,
        // |(p - p_k)·n_k| is at most (IN_FRONT + x·y/√2)·R, and x·y at most a²/4. The quad is rotated to the projected
        // ellipse, and bounds the slab.
        float thickness = IN_FRONT / a * ellipse.across + 0.177 * a * r;
        vec3 along = ellipse.along * ellipse.axis, across = ellipse.across * cross(v_normal, ellipse.axis), v = cross(axis, u);
        mat2 C = mat2(dot(along, u), dot(across, u), dot(along, v), dot(across, v));
        float angle = 0.5 * atan(2.0 * dot(C[0], C[1]), dot(C[0], C[0]) - dot(C[1], C[1]) + 1e-30);
        u = cos(angle) * u + sin(angle) * v;
        v = cross(axis, u);
        reach = min(r, length(vec2(dot(along, forward), dot(across, forward))) + thickness * abs(dot(v_normal, forward)));
        vec3 extent;
        extent.x = length(vec2(dot(along, u), dot(across, u))) + thickness * abs(dot(v_normal, u));
        extent.y = length(vec2(dot(along, v), dot(across, v))) + thickness * abs(dot(v_normal, v));
        extent.z = length(vec2(dot(along, axis), dot(across, axis))) + thickness * abs(dot(v_normal, axis));
        if (extent.z < d) half_size = min(half_size, extent.xy * d / (d - extent.z));
    }
    vec3 v = cross(axis, u);
    half_size = max(half_size, pixel * d);  // a quad smaller than a pixel could miss all pixel centres
    gl_Position = clip_from_world * vec4(p + half_size.x * corner.x * u + half_size.y * corner.y * v, 1.0);
    // the depth test rejects pixels with a surface in front of the record's reach; 1e-3 exceeds rounding
    float nearest = (1.0 - 1e-3) * (dot(p - eye, forward) - reach);
    gl_Position.z = (2.0 * splat_depth(nearest) - 1.0) * gl_Position.w;
}
