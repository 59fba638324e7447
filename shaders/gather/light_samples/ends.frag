// Ends of the next-event rays of records, for Embree to trace: a row a record, a texel a sample.
#include "gather/light_samples/sample.glsl"
#include "gather/places.glsl"

layout(location = 0) out vec4 out_away;  // from the eye, metres; w: 1 where light may come from there, else 0

void main()
{
    int s = int(gl_FragCoord.x);
    LightSample found = light_sample(float(s), viewpoint(place_of_sample(int(gl_FragCoord.y), s)));
    out_away = vec4(found.source.away, found.possible ? 1.0 : 0.0);
}
