"""The truth of a view by path tracing (extra `reference`), kept on disk, and how far a frame is from it."""
