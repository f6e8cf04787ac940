"""The commands of the runtime: their arguments, what these mean, and what each command does."""
