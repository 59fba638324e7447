"""Invalid input: kinds and places of files, arguments of the library, and the owner of a renderer."""
