"""Short scripts that show the Python interface; each runs as `python -m analysis.examples.NAME`."""
