"""Where a run says that it is there: one small JSON file a run, in a folder of the user's."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from rig.errors import RigError

ANNOUNCEMENT_VERSION = 2


@dataclass(frozen=True, slots=True)
class Announcement:
    """What another process needs to follow a run, or to ask something of it.

    `token` goes with every request: who can read this file, the user alone, may ask.
    """

    version: int
    pid: int
    title: str
    out: str
    ring: str
    snapshots: str
    requests: str
    token: str


def folder() -> Path:
    """Return the folder of announcements: $INDENTER_RUNTIME_DIR, else one in the user's cache folder."""
    import platformdirs

    given = os.environ.get("INDENTER_RUNTIME_DIR")
    return Path(given) if given else platformdirs.user_cache_path("indenter") / "runs"


def announce(announcement: Announcement) -> Path:
    """Write the announcement, whole or not at all; return its file, to be removed when the run ends.

    Raises RigError where the folder can't be written.
    """
    path = folder() / f"run-{announcement.pid}.json"
    part = path.with_suffix(".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        part.unlink(missing_ok=True)
        # nobody else may read it, not even for a moment
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(json.dumps(asdict(announcement)))
        part.replace(path)
    except OSError as error:
        raise RigError(
            f"{path.parent}: the run can't be announced there ({error.strerror}): "
            "set INDENTER_RUNTIME_DIR to a folder that can be written"
        ) from error
    return path


def announcements() -> list[Announcement]:
    """Return the runs announced, the newest first; those of another version are passed over."""
    found = []
    for path in folder().glob("run-*.json"):
        announcement = read_announcement(path)
        if announcement is not None:
            with suppress(OSError):  # a run that has ended meanwhile
                found.append((path.stat().st_mtime, announcement))
    return [announcement for _, announcement in sorted(found, key=lambda pair: -pair[0])]


def announcement_of(pid: int) -> Announcement | None:
    """Return what the program of this process number has announced; None where that is nothing."""
    return read_announcement(folder() / f"run-{pid}.json")


def read_announcement(path: Path) -> Announcement | None:
    """Return an announcement; None where the file is none, or one of another version."""
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(said, dict) or said.get("version") != ANNOUNCEMENT_VERSION:
            return None
        return Announcement(**said)
    except (OSError, ValueError, TypeError, RecursionError):
        return None
