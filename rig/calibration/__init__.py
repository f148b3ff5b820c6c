"""From calibration runs to constants that belong to a rig."""
