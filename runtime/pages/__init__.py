"""What all HTML pages share: a frame, a stylesheet and charts. Imports only the standard library."""
