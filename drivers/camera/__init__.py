"""Camera: measures a tag's pose on a known plane, and judges whether its part lies at the leaf's pose."""
