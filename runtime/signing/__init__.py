"""Signed packs: the files that a cell runs, with the signature of a person who vouches for them."""
