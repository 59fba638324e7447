// How many rays, or texels, of a record look into a steradian about the unit direction w of its frame.
uniform float rays;  // of strata: their number over π; of a hemicube: texels per unit of the plane at distance 1, at a face's middle

float ray_density(vec3 w)
{
#if STRATA
    return rays * w.z;
#else
    float ahead = max(max(abs(w.x), abs(w.y)), w.z);
    return rays / (ahead * ahead * ahead);
#endif
}
