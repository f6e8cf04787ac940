"""The camera: a tag's pose on a known plane, and whether a part lies where its leaf says it does."""
