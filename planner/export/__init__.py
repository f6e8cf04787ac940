"""A table for controllers without Python: C99, structured text or JSON, and vectors that check it."""
