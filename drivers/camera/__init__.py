"""Camera: measures a part by its tag, and judges whether the part lies where the planner's table says."""
