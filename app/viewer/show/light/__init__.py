"""Light of the view in numbers: on a measuring plane, and at one point by its sources."""
