"""The runner: the only thing that acts."""
