"""What rig.toml and protocol.toml may say: validated models with units in the names."""
