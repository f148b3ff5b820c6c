"""The other end of the feed: follow a run from another process, and ask something of it."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Self

import zmq

from rig.engine.announcing import Announcement, announcements
from rig.engine.feed import HEARTBEAT_S
from rig.engine.progress import Snapshot
from rig.engine.requests import Request, make_request, sealed
from rig.engine.ring import RingReader

SILENT_S = 4 * HEARTBEAT_S
"""A run that says nothing for so long is gone."""


class Follower:
    """Follows one announced run, as a context manager; it only pulls, and never holds the run up."""

    def __init__(self, announcement: Announcement) -> None:
        self.announcement = announcement
        self.ring = RingReader(announcement.ring)
        self._context = zmq.Context()
        self._snapshots = self._context.socket(zmq.SUB)
        self._snapshots.setsockopt(zmq.SUBSCRIBE, b"")
        self._snapshots.connect(announcement.snapshots)
        self._requests = self._context.socket(zmq.PUSH)
        self._requests.setsockopt(zmq.LINGER, 500)
        self._requests.connect(announcement.requests)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._snapshots.close(linger=0)
        self._requests.close()
        self._context.term()
        self.ring.close()

    def snapshot(self, timeout_s: float = SILENT_S) -> Snapshot | None:
        """Return the newest snapshot, waiting for one; None where the run has been silent for so long."""
        if not self._snapshots.poll(round(1000 * timeout_s)):
            return None
        message = self._snapshots.recv()
        while self._snapshots.poll(0):
            message = self._snapshots.recv()
        return Snapshot.from_message(message)

    def request(self, do: str, **more: Any) -> str:
        """Ask the run for something (`rig.engine.requests` says what); return the request's id.

        It counts as taken on only when a snapshot says so, under this id: a message to a dead run is
        accepted in silence. ValueError where it is no request.
        """
        return self.send(make_request(do, **more))

    def send(self, request: Request) -> str:
        """Send a request; return its id."""
        with suppress(zmq.Again):  # nobody takes them: no verdict will come
            self._requests.send(sealed(request, self.announcement.token), zmq.NOBLOCK)
        return request.id


def follow_newest() -> Follower | None:
    """Return a follower of the newest run that still lives; None where there is none."""
    for announcement in announcements():
        try:
            follower = Follower(announcement)
        except (FileNotFoundError, ValueError):
            continue  # its program has died, or is of another version
        if follower.snapshot() is not None:
            return follower
        follower.__exit__()
    return None
