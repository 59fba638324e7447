// Writes a record's limit into the cache as it was found.
flat in float v_limit;

layout(location = 0) out float out_limit;

void main()
{
    out_limit = v_limit;
}
