"""What a run shows to other processes: samples in shared memory, snapshots as messages, and an open ear."""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import zmq

from analysis.recordings.trial import Calibration
from rig.engine.announcing import ANNOUNCEMENT_VERSION, Announcement, announce
from rig.engine.progress import Snapshot
from rig.engine.requests import MAX_BYTES, Request, Verdict, parse_request
from rig.engine.ring import IDLE, TRIAL, SampleRing
from rig.engine.states import State
from rig.hardware.lever import Chunk

_log = logging.getLogger(__name__)

RING_S = 60.0
"""Live samples kept: a window can show the last minute."""

HEARTBEAT_S = 0.5
"""The last snapshot is sent again so often: one who hears nothing for longer knows that the run is gone."""

_ANSWERS_KEPT = 16
_REQUESTS_AT_ONCE = 32
"""Requests taken between two snapshots: a flood of them holds up nothing but itself."""


def _nothing_runs(request: Request) -> Verdict:
    return Verdict(request.id, accepted=False, why="this run takes no requests")


class Feed:
    """Publishes what happens on one bench, as a context manager; `follow`, `show` and `mark` never wait.

    A thread of its own keeps the sockets: it sends each snapshot, sends the last one again to whoever
    subscribes and at every heartbeat, and hands requests from other processes to `on_request`, whose
    verdicts go out with the snapshots. A request counts only with the token of the announcement, once;
    whatever else comes to the open port is passed over. Whoever follows before anything was shown gets `first`.
    """

    def __init__(
        self,
        title: str,
        out: Path,
        sample_rate_hz: float,
        calibration: Calibration,
        on_request: Callable[[Request], Verdict] = _nothing_runs,
        first: Snapshot | None = None,
    ) -> None:
        self._title = title
        self._out = out
        self._on_request = on_request
        self._rate_hz = sample_rate_hz
        self._token = secrets.token_urlsafe(24)
        self._ring = SampleRing(int(RING_S * sample_rate_hz), sample_rate_hz, calibration)
        self._writing, self._sending = threading.Lock(), threading.Lock()
        self._trial_began = 0
        self._n_trials = 0
        self._context = zmq.Context()
        self._inbox = self._context.socket(zmq.PAIR)
        self._inbox_address = f"inproc://feed-{id(self)}"
        self._inbox.bind(self._inbox_address)
        self._ready = threading.Event()
        self._addresses = ("", "")
        self._last = first or Snapshot(title=title, state=State.IDLE, out=str(out))
        self._number = 0
        self._answers: deque[Verdict] = deque(maxlen=_ANSWERS_KEPT)
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
                token=self._token,
            )
        )
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.unlink(missing_ok=True)
        with self._sending, contextlib.suppress(zmq.Again):
            self._inbox.send(b"", zmq.NOBLOCK)
        self._thread.join(2.0)
        self._inbox.close(linger=0)
        if not self._thread.is_alive():
            self._context.term()
        self._ring.close()

    def follow(self, chunk: Chunk) -> None:
        """Show samples as they come; from any thread."""
        with self._writing:
            self._ring.write(chunk.position_v, chunk.force_v, chunk.command_v)

    def mark(self, name: str, sample: int, now: int) -> None:
        """Set a mark at a sample of the trial, which is at sample `now`.

        "trial" begins one, "idle" what is shown and not recorded.
        """
        time_s = time.time() - (now - sample) / self._rate_hz
        with self._writing:
            if name in {TRIAL, IDLE}:
                self._trial_began = self._ring.written - now
            if name == TRIAL:
                self._n_trials += 1
            self._ring.mark(name, self._trial_began + sample, time_s, self._n_trials)

    def show(self, snapshot: Snapshot) -> None:
        """Show what the run does now; from any thread. A full outbox drops it: the next one stands for it."""
        message = snapshot.as_message()
        with self._sending, contextlib.suppress(zmq.Again):
            self._inbox.send(message, zmq.NOBLOCK)

    def _serve(self) -> None:
        out = self._context.socket(zmq.XPUB)
        requests = self._context.socket(zmq.PULL)
        requests.setsockopt(zmq.MAXMSGSIZE, 2 * MAX_BYTES)
        requests.setsockopt(zmq.RCVHWM, 4 * _REQUESTS_AT_ONCE)
        inbox = self._context.socket(zmq.PAIR)
        inbox.connect(self._inbox_address)
        self._addresses = tuple(
            f"tcp://127.0.0.1:{socket.bind_to_random_port('tcp://127.0.0.1')}" for socket in (out, requests)
        )  # type: ignore[assignment]
        self._ready.set()
        poller = zmq.Poller()
        for socket in (out, requests, inbox):
            poller.register(socket, zmq.POLLIN)
        sent_at = 0.0
        while True:
            due_s = sent_at + HEARTBEAT_S - time.monotonic()
            ready = dict(poller.poll(max(0, round(1000 * due_s))))
            send = out in ready or time.monotonic() - sent_at >= HEARTBEAT_S
            if out in ready:
                out.recv()
            if requests in ready:
                send |= self._hear(requests)
            if inbox in ready:
                message = inbox.recv()
                if not message:
                    break
                self._last = Snapshot.from_message(message)
                send = True
            if send:
                self._number += 1
                shown = replace(self._last, number=self._number, answered=tuple(self._answers))
                out.send(shown.as_message(), zmq.NOBLOCK)
                sent_at = time.monotonic()
        for socket in (out, requests, inbox):
            socket.close(linger=200)

    def _hear(self, requests: zmq.Socket[Any]) -> bool:
        """Take the requests that have come; say whether any was answered."""
        answered = False
        for _ in range(_REQUESTS_AT_ONCE):
            try:
                message = requests.recv(zmq.NOBLOCK)
            except zmq.Again:
                break
            verdict = self._verdict(message)
            if verdict is not None:
                self._answers.append(verdict)
                answered = True
        return answered

    def _verdict(self, message: bytes) -> Verdict | None:
        request = parse_request(message, self._token)
        if request is None or isinstance(request, Verdict):
            return request
        for earlier in self._answers:
            if earlier.id == request.id:
                return None  # asked twice, done once
        try:
            return self._on_request(request)
        except Exception:  # noqa: BLE001 - whatever it is, the ear stays open
            _log.exception("a request could not be taken on")
            return Verdict(request.id, accepted=False, why="a fault of the program; its log says more")


__all__ = ["HEARTBEAT_S", "IDLE", "RING_S", "Feed"]
