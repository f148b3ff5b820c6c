"""Where a run says that it is there: one small JSON file a run, in a folder of the user's."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

from rig.errors import RigError

ANNOUNCEMENT_VERSION = 1


@dataclass(frozen=True, slots=True)
class Announcement:
    """What another process needs to follow a run, or to ask it to stop."""

    version: int
    pid: int
    title: str
    out: str
    ring: str
    snapshots: str
    requests: str


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
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(json.dumps(asdict(announcement)), encoding="utf-8")
        part.replace(path)
    except OSError as error:
        raise RigError(
            f"{path.parent}: the run can't be announced there ({error.strerror}): "
            "set INDENTER_RUNTIME_DIR to a folder that can be written"
        ) from error
    return path


def announcements() -> list[Announcement]:
    """Return the runs announced, the newest first; a file that can't be read is passed over."""
    found = []
    for path in folder().glob("run-*.json"):
        try:
            found.append((path.stat().st_mtime, Announcement(**json.loads(path.read_text(encoding="utf-8")))))
        except (OSError, ValueError, TypeError):
            continue  # a run that ended meanwhile, or one of another version
    return [announcement for _, announcement in sorted(found, key=lambda pair: -pair[0])]
