"""The way of a part through a table: decisions, requests and results, without devices, files or clocks."""
