"""Output of frames: OpenEXR layers, false colours with a legend, and a contact sheet of all buffers."""
