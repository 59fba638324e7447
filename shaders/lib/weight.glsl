// The weight of a record for a point, kept finite by a least error.
uniform float a;

// LEAST_ERROR and IN_FRONT (of R_k: how far in front of a pixel's surface, or behind it, a record may lie) are settings.py's.

// `apart` = p - p_k in metres, R in metres, unit normals n of the point and n_k of the record; 0 where it does not speak.
float record_weight(vec3 apart, float R, vec3 n, vec3 n_k, bool in_front)
{
    float cosine = dot(n, n_k);
    if (in_front && (cosine <= 0.0 || abs(dot(apart, n + n_k)) * 0.5 > IN_FRONT * R)) return 0.0;
    return 1.0 / max(length(apart) / R + sqrt(max(0.0, 1.0 - cosine)), LEAST_ERROR);
}
