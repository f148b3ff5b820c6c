"""Trials in."""
