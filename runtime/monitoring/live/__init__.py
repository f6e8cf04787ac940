"""The live page, which follows a run in a browser; its modules are loaded only if a run serves the page."""
