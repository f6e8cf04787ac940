"""The commands of the cell: their arguments, checks of these, and what the commands do."""
