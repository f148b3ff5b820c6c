"""A stream: whatever the reader does, the card never holds more than the lead beyond what was looked at."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rig.hardware.daq import CardStream
from rig.hardware.errors import OutputStarvedError
from rig.hardware.playback import StreamPlayback

LEAD = 240


class Output:
    """A card that plays one sample a tick from ``started`` on, and starves when it has none."""

    def __init__(self, started: int) -> None:
        self.started = started
        self.written = LEAD
        self.now = 0
        self.starved_at: int | None = None

    def tick(self, n: int) -> None:
        self.now += n
        if self.starved_at is None and self.now - self.started > self.written:
            self.starved_at = self.written

    def generated(self) -> int:
        return min(max(self.now - self.started, 0), self.written)

    def write(self, volts: np.ndarray[Any, Any]) -> None:
        if self.starved_at is not None:
            raise OutputStarvedError("dry", -200290)
        self.written += len(volts)


@given(
    late=st.integers(0, 500),
    length=st.integers(2, 4000),
    reads=st.lists(st.tuples(st.integers(1, 400), st.integers(0, 300)), max_size=60),
)
def test_no_more_than_the_lead_is_ever_ahead_of_what_was_looked_at(
    late: int, length: int, reads: list[tuple[int, int]]
) -> None:
    """``reads``: samples that come, and how many of those that came stay unread for the moment."""
    output = Output(started=100 + late)
    output.written = min(LEAD, length)
    stream = StreamPlayback(
        cast(CardStream, output),
        np.zeros(length),
        expected_sample=100,
        not_before=100,
        lead_samples=LEAD,
        finder=None,
        samples_read=lambda: 0,
    )
    output.now = 100
    judged = 100
    for n, unread in reads:
        output.tick(n)
        judged = max(judged, output.now - unread)
        try:
            stream.release(judged)
        except OutputStarvedError:
            break
        assert len(stream.sent_v) == output.written <= length
        assert output.written - output.generated() <= LEAD, "the card holds no more than the lead"
        assert output.written <= max(judged - 100, 0) + LEAD, "nor beyond what was looked at"
