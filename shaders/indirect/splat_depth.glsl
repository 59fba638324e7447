// The depth buffer of splats: how far surfaces are along the view axis, so that a record behind a surface is not looked at there.

// A depth in metres as 0..1, greater for what is farther; 0: at the eye or behind it. Equally fine near and far, at every scale.
float splat_depth(float metres)
{
    return clamp(log2(max(metres, 1e-37)) / 128.0 + 0.5, 0.0, 1.0);
}
