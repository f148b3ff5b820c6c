"""Conceal effects in the simulated rig, diagnose blind, open, score."""
