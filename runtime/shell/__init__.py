"""What every command of the project shares at the command line; nothing but the standard library."""
