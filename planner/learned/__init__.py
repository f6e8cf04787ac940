"""The motion model of the paper, learned from roll-outs (paper V)."""
