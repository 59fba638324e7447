// From where a record looks: from one place, or from PLACES of them in turn, texel by texel and sample by sample.
#ifndef PLACES
#define PLACES 1
#endif

// Column of `frames` with the eye of a texel of a record's cell.
int place_of_texel(int record, ivec2 texel)
{
    return record * PLACES + (texel.x + 2 * texel.y) % PLACES;  // as places_of_texels in record_frame.py has it
}

// Column of `frames` with the eye of a next-event sample.
int place_of_sample(int record, int s)
{
    return record * PLACES + s % PLACES;
}
