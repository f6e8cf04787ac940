"""The commands beside `grasp-runtime`, and the options of all."""
