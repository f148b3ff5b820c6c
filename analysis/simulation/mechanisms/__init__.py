"""The physics library: one file a mechanism, found by listing this folder."""
