// States of the cells of a view, `rest.z` (METHOD.md, 8.2); 0: full light, or no surface.
const float HOLE = 1.0;    // no record
const float COARSE = 0.5;  // a record by coarse light
