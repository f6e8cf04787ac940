"""The commands of the cell: for each its arguments, the checks of these arguments, and what it does."""
