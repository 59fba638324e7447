// How far a record reaches in this view: its own radii within the bounds that the view sets.
#include "records/weight.glsl"
#include "records/record.glsl"

uniform vec3 eye;
uniform vec2 radius_bounds;  // least and greatest a·R in metres at distance 1 from the eye; 0: no greatest

// The radius a·R in metres within the view's bounds; distance: metres from the eye.
float view_radius(float R, float distance)
{
    float r = max(a * R, radius_bounds.x * distance);
    return radius_bounds.y > 0.0 ? min(r, radius_bounds.y * distance) : r;
}

// Both radii a·R of the record at `texel`, with its own limit and the view's bounds. trust: the share of the radii that the record's
// error allows; below 1 where the least radius of the view is greater.
Ellipse view_ellipse(ivec2 texel, float distance, out float trust)
{
    Ellipse own = record_ellipse(texel);
    float limit = record_limit(texel);
    Ellipse here = Ellipse(own.axis, view_radius(own.along * limit, distance), view_radius(own.across * limit, distance));
    trust = min(1.0, a * own.across * limit / here.across);
    return here;
}
