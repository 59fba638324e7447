"""Common parts of commands: flags, their values, and the steps before and after a render."""
