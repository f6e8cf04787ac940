"""Models made from roll-outs (paper V)."""
