// The radii of a record in a view: the record's radii, clamped to bounds that depend on the distance from the eye (METHOD.md,
// 5.4).
#include "records/weight.glsl"
#include "records/record.glsl"

uniform vec3 eye;            // world space, metres
uniform vec2 radius_bounds;  // least and greatest a·R at distance 1 from the eye, metres; 0: no greatest

// Return the radius a·R within the bounds of the view, metres. distance: from the eye, metres.
float view_radius(float R, float distance)
{
    float r = max(a * R, radius_bounds.x * distance);
    return radius_bounds.y > 0.0 ? min(r, radius_bounds.y * distance) : r;
}

// Return the ellipse of radii a·R of the record at `texel`, with its limit and the bounds of the view. trust: ratio of the
// record's to the returned radii, at most 1; it is less than 1 if the least radius of the view is greater than the record's.
Ellipse view_ellipse(ivec2 texel, float distance, out float trust)
{
    Ellipse record = record_ellipse(texel);
    float limit = record_limit(texel), share = limit < 0.0 ? 1.0 : limit;
    vec2 radii = vec2(view_radius(record.along * share, distance), view_radius(record.across * share, distance));
    if (limit < 0.0) radii = min(radii, vec2(-limit));
    trust = min(1.0, a * record.across * share / radii.y);
    return Ellipse(record.axis, radii.x, radii.y);
}
