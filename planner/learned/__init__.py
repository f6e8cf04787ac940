"""Motion models learned from roll-outs, for `model = "kcde"` and for the paper's method (paper V)."""
