"""The work of those commands that have no room of their own; imported when it is called for."""
