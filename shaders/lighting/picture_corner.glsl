uniform ivec2 picture_corner;  // the pixel of the whole picture that is the first one here
