"""What is said of it all."""
