// Nothing to write: the depth buffer is the shadow map.
void main() {}
