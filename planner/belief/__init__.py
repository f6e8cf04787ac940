"""Beliefs about the part: particles, the goal's metric, the encoder's readings, the effect of a squeeze."""
