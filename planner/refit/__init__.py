"""What a cell's own journals tell of it: the posterior of what stays off in all its squeezes."""
