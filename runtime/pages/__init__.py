"""Pages for a browser: one frame, one stylesheet, one set of charts. Standard library only."""
