"""Search for the tree of squeezes (paper VI)."""
