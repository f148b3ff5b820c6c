"""The finger pad in three dimensions: calibrated on trials, compared in space, asked what a receptor feels."""
