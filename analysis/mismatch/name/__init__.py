"""Which effects predict the recordings best."""
