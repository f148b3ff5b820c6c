"""The commands of `indenter` that run a bench, a file each."""
