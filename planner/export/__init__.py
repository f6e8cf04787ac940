"""Export of a table for controllers without Python: C99, structured text or JSON, with test vectors."""
