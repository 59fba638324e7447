// Numbers that more than one stage uses.
const float PI = 3.14159265358979;
const float INV_PI = 0.318309886183791;
const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);  // Rec. 709
