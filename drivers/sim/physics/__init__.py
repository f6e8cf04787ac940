"""What lies between the fingers: the scene, the part on the table, and the scene's protocol."""
