"""The simulated camera: realistic pictures of tags and boards on a table, and a server for them."""
