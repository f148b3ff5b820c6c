"""Where simulation and recordings differ, which physics was left out, and the proof."""
