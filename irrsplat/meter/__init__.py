"""Light at points and on planes, as a luxmeter reads it: no camera, nothing interpolated."""
