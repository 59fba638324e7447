uniform vec3 low;   // the corners of a box around the scene, metres
uniform vec3 high;

// The corner of a footprint that lies at `way` from the eye, or the place in the box that is nearest to it: where a wall ends its
// plane goes on, but what lies outside is nobody's surface, and as it is farther from all lamps the mean would be too dark.
vec3 within_box(vec3 eye, vec3 way)
{
    return clamp(way, low - eye, high - eye);
}
