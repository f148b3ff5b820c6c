"""What runs while a finger is on the block: protocols, engine, hardware, command line."""
