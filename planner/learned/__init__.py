"""The motion model that the paper learns from roll-outs (paper V)."""
