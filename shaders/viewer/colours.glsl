// Numbers 0..1 as colours, by a table of app/viewer/show/screen.py.
uniform sampler2D colours;  // lower row: viridis; upper row: sRGB, equal in all channels

// Return the colour of t in the row of the table at the texture coordinate `row`.
vec4 colour(float t, float row)
{
    float n = float(textureSize(colours, 0).x);
    return textureLod(colours, vec2((clamp(t, 0.0, 1.0) * (n - 1.0) + 0.5) / n, row), 0.0);
}

// Return the colour of t by viridis.
vec3 heat(float t)
{
    return colour(t, 0.25).rgb;
}

// Return a linear colour, sRGB-encoded.
vec3 encoded(vec3 linear)
{
    return vec3(colour(linear.r, 0.75).r, colour(linear.g, 0.75).r, colour(linear.b, 0.75).r);
}
