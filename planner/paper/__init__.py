"""The paper's method as printed, for `method = "paper"`, and Goldberg's sensorless plans for comparison."""
