"""The Maxwell-Weichert solid: response to any motion, fits, study tables."""
