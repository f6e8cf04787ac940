"""Studio: a local page for a folder of drawings and plans; commands do all work, files hold all state."""
