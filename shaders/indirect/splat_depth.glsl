// The depth buffer of splats: depth of surfaces along the view axis. The depth test rejects pixels in front of a record's reach.

// Return a depth in metres as 0..1; 0: at the eye or behind it. The logarithm has equal relative precision at all scales.
float splat_depth(float metres)
{
    return clamp(log2(max(metres, 1e-37)) / 128.0 + 0.5, 0.0, 1.0);
}
