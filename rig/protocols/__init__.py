"""Protocols as data: builders of steps, without input or output."""
