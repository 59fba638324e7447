"""Light of the view in numbers: how bright it is, and how it runs along a line."""
