"""Damaged and hostile input for every reader: each input gives a result or a one-line error."""
