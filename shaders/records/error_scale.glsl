// The error scale: the luminance to which an error is relative (METHOD.md, 5.3).
uniform float luminance_floor;  // W/m²

// Return the error scale at the luminance Y, both in W/m²: Y, at least the floor. Above BRIGHT times the floor, it is the
// geometric mean of Y and this limit. irrsplat/records/weight.py has the NumPy version.
float error_scale(float Y)
{
    float least = max(luminance_floor, 1e-20), bright = luminance_floor > 0.0 ? BRIGHT * luminance_floor : 1e30;
    return Y > bright ? sqrt(bright * Y) : max(Y, least);
}
