"""A local page for a folder of drawings and plans: all work is done by commands, all state is in files."""
