"""Damaged and hostile input for every reader: whatever it is, there is a result or one line of an error."""
