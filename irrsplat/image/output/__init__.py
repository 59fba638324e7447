"""What a frame becomes: OpenEXR layers, false colours with a legend, and a contact sheet of all buffers."""
