"""Pictures of squeezes and of plans. Importing most of its modules loads matplotlib."""
