// The density of cosine-distributed rays (METHOD.md, 3.8).
uniform float rays;  // number of rays per record, divided by π

// Return the rays per steradian of a record in the unit direction w of its frame.
float ray_density(vec3 w)
{
    return rays * w.z;
}
