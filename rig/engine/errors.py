"""What can go wrong while a trial runs, beside the hardware; each message is one line with what to do."""

from __future__ import annotations

from rig.errors import RigError


class SurfaceNotFoundError(RigError):
    """The approach ended without contact."""


class ContactTooEarlyError(RigError):
    """The arm met something where only air was expected."""
