"""Pictures of squeezes and of plans. Only its modules import matplotlib, so import them where one is drawn."""
