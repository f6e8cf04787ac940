"""Live views of a run in a browser; loaded only on request."""
