"""The part: its outline, its rotational symmetry, and how it presses on the table (paper, II and VII)."""
