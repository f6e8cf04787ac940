"""Pictures, tags and lenses: from pixels to poses on the table."""
