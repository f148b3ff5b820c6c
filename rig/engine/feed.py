"""What a run shows to other processes: samples in shared memory, snapshots as messages, and an open ear."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import zmq

from analysis.recordings.trial import Calibration
from rig.engine.announcing import ANNOUNCEMENT_VERSION, Announcement, announce
from rig.engine.progress import Snapshot
from rig.engine.ring import SampleRing
from rig.hardware.lever import Chunk

RING_S = 60.0
"""Live samples kept: a window can show the last minute."""

HEARTBEAT_S = 0.5
"""The last snapshot is sent again so often: one who hears nothing for longer knows that the run is gone."""


class Feed:
    """Publishes one run, as a context manager; `follow` and `show` are its observers' calls.

    A thread of its own keeps the sockets: it sends each snapshot, sends the last one again to whoever
    subscribes and at every heartbeat, and hands requests from other processes, as dictionaries, to
    `on_request`.
    """

    def __init__(
        self,
        title: str,
        out: Path,
        sample_rate_hz: float,
        calibration: Calibration,
        on_request: Callable[[dict[str, Any]], None] = lambda _: None,
    ) -> None:
        self._title = title
        self._out = out
        self._on_request = on_request
        self._ring = SampleRing(int(RING_S * sample_rate_hz), sample_rate_hz, calibration)
        self._context = zmq.Context()
        self._inbox = self._context.socket(zmq.PAIR)
        self._inbox_address = f"inproc://feed-{id(self)}"
        self._inbox.bind(self._inbox_address)
        self._ready = threading.Event()
        self._addresses = ("", "")
        self._thread = threading.Thread(target=self._serve, name="feed", daemon=True)
        self._file: Path | None = None

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait()
        snapshots, requests = self._addresses
        self._file = announce(
            Announcement(
                version=ANNOUNCEMENT_VERSION,
                pid=os.getpid(),
                title=self._title,
                out=str(self._out),
                ring=self._ring.name,
                snapshots=snapshots,
                requests=requests,
            )
        )
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.unlink(missing_ok=True)
        self._inbox.send(b"")
        self._thread.join()
        self._inbox.close(linger=0)
        self._context.term()
        self._ring.close()

    def follow(self, chunk: Chunk) -> None:
        """Show samples as they come."""
        self._ring.write(chunk.position_v, chunk.force_v, chunk.command_v)

    def show(self, snapshot: Snapshot) -> None:
        """Show what the run does now; from the thread that runs it."""
        self._inbox.send(json.dumps(snapshot.as_message()).encode())

    def _serve(self) -> None:
        out = self._context.socket(zmq.XPUB)
        requests = self._context.socket(zmq.PULL)
        inbox = self._context.socket(zmq.PAIR)
        inbox.connect(self._inbox_address)
        self._addresses = tuple(
            f"tcp://127.0.0.1:{socket.bind_to_random_port('tcp://127.0.0.1')}" for socket in (out, requests)
        )  # type: ignore[assignment]
        self._ready.set()
        poller = zmq.Poller()
        for socket in (out, requests, inbox):
            poller.register(socket, zmq.POLLIN)
        last = b""
        while True:
            ready = dict(poller.poll(round(1000 * HEARTBEAT_S)))
            if inbox in ready:
                last = inbox.recv() or b""
                if not last:
                    break
            if out in ready:
                out.recv()
            if requests in ready:
                self._heard(requests.recv())
            if last and (inbox in ready or out in ready or not ready):
                out.send(last)
        for socket in (out, requests, inbox):
            socket.close(linger=200)

    def _heard(self, message: bytes) -> None:
        """Hand a request on; what is no request is passed over, as anyone may write to an open port."""
        try:
            request = json.loads(message)
        except ValueError:
            return
        if isinstance(request, dict):
            self._on_request(request)
