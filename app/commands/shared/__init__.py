"""Common parts of commands: flags, and the steps before and after a render."""
