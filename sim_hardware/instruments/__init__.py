"""The serial instruments of the bench: Z stage and balance."""
