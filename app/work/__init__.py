"""Work of commands without a folder of their own; imported on demand."""
