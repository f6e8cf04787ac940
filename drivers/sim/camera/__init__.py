"""The simulated camera: honest pictures of tags and boards on a table, and a server that shows them."""
