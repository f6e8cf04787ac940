"""The camera's calibration: lens, place, tags, and their drift."""
