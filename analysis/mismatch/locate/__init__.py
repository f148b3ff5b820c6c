"""Where simulation and recordings differ."""
