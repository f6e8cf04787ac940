"""The simulated devices: grippers of several makes, and an arm with its RAPID server or UR controller."""
