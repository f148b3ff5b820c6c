"""What other programs recorded, read into drafts of trials: one module a format, and what they share."""
