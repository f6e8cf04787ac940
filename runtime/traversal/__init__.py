"""What a reading means at a node, what follows from it, and what a part came to: no device, file or clock."""
