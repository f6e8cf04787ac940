"""Pictures of squeezes and of plans. Importing one of its modules loads matplotlib."""
