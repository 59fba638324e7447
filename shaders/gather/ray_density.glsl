// The density of a record's rays about the unit direction w of its frame, per steradian.
uniform float rays;  // their number over π

float ray_density(vec3 w)
{
    return rays * w.z;
}
