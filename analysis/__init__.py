"""What can be done on a laptop, without the rig: recordings, fits, diagnosis."""
