"""Signed packs: the software of a cell, and who vouches for it."""
