"""The world behind the card: lever, punch, specimens, sensors, converters, and the operator's hands."""

from sim_hardware.world.bench import ArmState, Readings, World

__all__ = ["ArmState", "Readings", "World"]
