"""The audit: predicted poses judged by a picture."""
