"""Input that cannot be: what files may be and where they lie, what the library is given, and who may use a renderer."""
