"""The commands of the runtime: arguments, their meaning, and actions."""
