"""The paper as printed, for `method = "paper"`, and Goldberg's sensorless plans to compare with."""
