"""Signed packs: what is installed in a cell, and who answers for it."""
