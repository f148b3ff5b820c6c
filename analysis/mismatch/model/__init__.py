"""What a trial is simulated from."""
