"""The forward model of a whole trial and the library of mechanisms."""
