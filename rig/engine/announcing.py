"""Where a run says that it is there: one small JSON file a run, in the user's runtime folder."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

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
    """Return the folder of announcements, made where it is missing.

    The environment's INDENTER_RUNTIME_DIR, where set, stands in place of the user's runtime folder.
    """
    import platformdirs

    given = os.environ.get("INDENTER_RUNTIME_DIR")
    path = Path(given) if given else platformdirs.user_runtime_path("indenter")
    path.mkdir(parents=True, exist_ok=True)
    return path


def announce(announcement: Announcement) -> Path:
    """Write the announcement, whole or not at all; return its file, to be removed when the run ends."""
    path = folder() / f"run-{announcement.pid}.json"
    part = path.with_suffix(".part")
    part.write_text(json.dumps(asdict(announcement)), encoding="utf-8")
    part.replace(path)
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
