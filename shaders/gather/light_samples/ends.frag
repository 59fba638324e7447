// Shadow rays of next-event estimation, which Embree traces: one row per record, one texel per sample (METHOD.md, 3.8).
#include "gather/light_samples/sample.glsl"
#include "gather/places.glsl"

layout(location = 0) out vec4 out_to_source;  // vector from the eye to the source, metres; w: 1 if it can contribute

void main()
{
    int s = int(gl_FragCoord.x);
    LightSample point = light_sample(float(s), viewpoint(place_of_sample(int(gl_FragCoord.y), s)));
    out_to_source = vec4(point.source.to_source, point.possible ? 1.0 : 0.0);
}
