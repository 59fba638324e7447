"""Output of frames: OpenEXR layers, and false colours with a legend."""
