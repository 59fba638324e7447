// How far two buffers differ at each pixel: the mean of the channels of |left - right|, in the colours of numbers.
#include "generated/constants.glsl"
#include "viewer/colours.glsl"

uniform sampler2D left_values;
uniform sampler2D right_values;
uniform sampler2D left_albedo;     // of form 3 alone
uniform sampler2D right_albedo;
uniform sampler2D left_position;   // g-buffer; w depth along the view axis, 0 where nothing is seen
uniform sampler2D right_position;
uniform int left_form;             // which number of a texel is meant, see Values.form
uniform int right_form;
uniform bool everywhere;           // whether there are values where nothing is seen, too
uniform float full;                // the difference in full colour
uniform vec3 ground;               // display colour where there are no values
uniform vec2 size;                 // of the target, pixels

layout(location = 0) out vec4 out_color;

vec3 number(vec4 texel, vec3 albedo, int form)
{
    if (form == 0) return texel.rgb;
    if (form == 1) return vec3(texel.r);
    if (form == 4) return vec3(texel.a);
    vec3 quotient = texel.a > 0.0 ? texel.rgb / texel.a : vec3(0.0);
    return form == 2 ? quotient : quotient * albedo * INV_PI;
}

ivec2 place(sampler2D values)
{
    return ivec2(gl_FragCoord.xy * vec2(textureSize(values, 0)) / size);
}

void main()
{
    ivec2 l = place(left_position), r = place(right_position);
    bool seen = texelFetch(left_position, l, 0).w > 0.0 && texelFetch(right_position, r, 0).w > 0.0;
    vec3 left = number(texelFetch(left_values, l, 0), texelFetch(left_albedo, l, 0).rgb, left_form);
    vec3 right = number(texelFetch(right_values, r, 0), texelFetch(right_albedo, r, 0).rgb, right_form);
    float difference = dot(abs(left - right), vec3(1.0 / 3.0));
    out_color = vec4(everywhere || seen ? heat(difference / full) : ground, 1.0);
}
