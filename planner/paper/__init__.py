"""The paper as printed, for `method = "paper"` and `"sensorless"`."""
