// The luminance in proportion to which an error is judged at a place (docs/METHOD.md, 5.3).
uniform float luminance_floor;  // W/m²

// Y: the luminance there, W/m². The scale is Y, at least the floor. Above BRIGHT times the floor it is the
// geometric mean of Y and that limit. The same in numpy is in irrsplat/records/weight.py.
float error_scale(float Y)
{
    float least = max(luminance_floor, 1e-20), bright = luminance_floor > 0.0 ? BRIGHT * luminance_floor : 1e30;
    return Y > bright ? sqrt(bright * Y) : max(Y, least);
}
