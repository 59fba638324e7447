// The eyes of a record: one, or several in turn, texel by texel and sample by sample.
uniform int places;  // eyes of a record, a power of two; 1 for records with derivatives

// Column of `frames` with the eye of a texel of a record's cell.
int place_of_texel(int record, ivec2 texel)
{
    return record * places + ((texel.x + 2 * texel.y) & (places - 1));  // as places_of_texels in record_frame.py has it
}

// Column of `frames` with the eye of a next-event sample.
int place_of_sample(int record, int s)
{
    return record * places + (s & (places - 1));
}
