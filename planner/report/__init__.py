"""Pictures of squeezes and of plans, and pages about them. Most modules of this package load matplotlib."""
