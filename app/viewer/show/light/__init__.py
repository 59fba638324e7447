"""Light of the view in numbers: along a line, on a measuring plane, and at one point by its sources."""
