// The eyes of a record. Sites of the surface cache have several, which alternate between texels and samples (METHOD.md, 11.4).
uniform int places;  // eyes per record, a power of two; 1 for records with derivatives

// Return the column of `frames` with the eye for a texel of a record's cell.
int place_of_texel(int record, ivec2 texel)
{
    return record * places + ((texel.x + 2 * texel.y) & (places - 1));  // as places_of_texels in irrsplat/gather/record_frame.py
}

// Return the column of `frames` with the eye for next-event sample s.
int place_of_sample(int record, int s)
{
    return record * places + (s & (places - 1));
}
