"""Gathering of records, and their update after changes of scene or settings."""
