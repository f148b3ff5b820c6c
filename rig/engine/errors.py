"""What can go wrong while a trial runs, beside the hardware; each message is one line with what to do."""

from __future__ import annotations

from rig.errors import RigError
from rig.hardware.errors import LimitRefusedError


class SurfaceNotFoundError(RigError):
    """The approach ended without contact."""


class FilingError(RigError):
    """A trial could not be written to its end; what was recorded is kept, or said to be lost."""


class DiskSilentError(FilingError):
    """The disk of a trial takes nothing any more; what it took before is there."""


class OvershotError(RigError):
    """The surface was overshot by too much for a trial to begin there."""


class ContactLostError(RigError):
    """The finger left the punch while it was to be held."""


class ContactTooEarlyError(RigError):
    """The arm met something where only air was expected."""


LEFT_LIKE = (LimitRefusedError, SurfaceNotFoundError, ContactLostError, ContactTooEarlyError, OvershotError)
"""What an arm that leaves for safety by itself looks like to the motion under way."""
