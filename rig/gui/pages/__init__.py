"""The pages of the bench window, a widget each."""
