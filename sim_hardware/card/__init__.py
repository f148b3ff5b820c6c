"""The simulated multifunction card: tasks, buffers and one 8000 Hz sample clock in front of the world."""

from sim_hardware.card.card import Card
from sim_hardware.card.errors import CardError

__all__ = ["Card", "CardError"]
