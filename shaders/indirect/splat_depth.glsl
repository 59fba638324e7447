// The depth buffer of splats: the depth of surfaces along the view axis, so that the depth test skips records behind a surface.

// A depth in metres as 0..1, increasing; 0: at the eye or behind it. Equally fine near and far, at every scale.
float splat_depth(float metres)
{
    return clamp(log2(max(metres, 1e-37)) / 128.0 + 0.5, 0.0, 1.0);
}
