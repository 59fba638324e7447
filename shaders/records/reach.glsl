// How far a record reaches in this view.
#include "records/weight.glsl"
#include "records/record.glsl"

uniform vec3 eye;
uniform vec2 reach;  // least and greatest a·R in metres at distance 1 (0: no greatest)

// The radius a·R in metres within what the view allows, `d` metres from the eye.
float view_radius(float R, float d)
{
    float r = max(a * R, reach.x * d);
    return reach.y > 0.0 ? min(r, reach.y * d) : r;
}

// The same for both radii of the record at `texel`, all limits together; `trust`: the share of its radii that the record itself
// stands for, where the least radius added to them.
Ellipse record_reach(ivec2 texel, float d, out float trust)
{
    Ellipse own = record_ellipse(texel);
    float limit = texelFetch(records_limit, texel, 0).r;
    Ellipse here = Ellipse(own.axis, view_radius(own.along * limit, d), view_radius(own.across * limit, d));
    trust = min(1.0, a * own.across * limit / here.across);
    return here;
}
