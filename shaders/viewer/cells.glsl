// Buffers with one texel for a square cell of pixels.
uniform int stride;    // pixels of the view, in x and in y, per texel
uniform ivec2 margin;  // pixels by which the cells overlap the view to the left and below

ivec2 cell_of(ivec2 pixel)
{
    return (pixel + margin) / stride;
}
