"""Fits: one trial, all trials, the noise, the laws."""
