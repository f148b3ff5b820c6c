"""Confirmation on trials that were not fitted."""
