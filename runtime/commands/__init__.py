"""The commands of the cell: their arguments, the checks of the arguments, and the commands' bodies."""
