"""What can go wrong while a rig runs; each message is one line: what, where, what to do."""


class RigError(RuntimeError):
    """A run failed (device, limit, operator); the command line turns it into exit code 1."""
