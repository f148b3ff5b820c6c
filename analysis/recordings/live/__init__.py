"""What keeps a trial file whole while it is written, and brings back one that was cut off."""
