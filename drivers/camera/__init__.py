"""The camera: measures a tag's pose on a known plane, and judges whether a part is at its leaf's pose."""
