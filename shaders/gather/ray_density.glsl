// How many rays of a record look into a steradian about the unit direction w of its frame.
uniform float rays;  // their number over π

float ray_density(vec3 w)
{
    return rays * w.z;
}
