// The luminance in proportion to which an error is judged at a place (docs/METHOD.md, 5.3).
uniform float luminance_floor;  // W/m²

// Y: the luminance there, W/m². It is Y itself but where that is dark or bright: at least the floor, and of what is more than
// BRIGHT times as bright as the floor the geometric mean with that much. The same in numpy is in irrsplat/records/weight.py.
float error_scale(float Y)
{
    float least = max(luminance_floor, 1e-20), bright = luminance_floor > 0.0 ? BRIGHT * luminance_floor : 1e30;
    return Y > bright ? sqrt(bright * Y) : max(Y, least);
}
