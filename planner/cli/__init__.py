"""The commands of the planner, one thin file each."""
