"""Calibration of a camera: its lens and pose, the tags on parts, and the check for drift."""
