"""A part's limit surface from logs of pushes."""
