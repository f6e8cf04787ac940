"""Physics of a simulated cell: the scene, the part on the table, and the scene's protocol."""
