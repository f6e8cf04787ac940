"""Live views of a run in a terminal or a browser; loaded only when asked for."""
