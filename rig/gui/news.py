"""What has become different between two snapshots of a bench, as lines for the log."""

from __future__ import annotations

from collections.abc import Iterator

from rig.engine.progress import Snapshot
from rig.engine.states import State
from rig.engine.tasks import Ended
from rig.gui.study_table import newly

Line = tuple[str, str]
"""Words, and their kind: "", "good", "note" or "bad"."""

_KINDS = {"complete": "good", "cut short": ""}
"""Of a trial that was cut short, who had it cut has been told already."""


def news(before: Snapshot, now: Snapshot) -> Iterator[Line]:
    """Yield what is to be said of the newer snapshot, apart from the state of the run."""
    if now.prompt is not None and (before.prompt is None or before.prompt.id != now.prompt.id):
        yield f"the bench asks: {now.prompt.words}", "note"
    for ended in newly(before.ended, now.ended):
        yield _ended_words(ended), _KINDS.get(ended.outcome, "note")
    if now.state is State.IDLE and not now.title and now.message and now.message != before.message:
        yield now.message, "note"
    if now.doubt is not None and now.doubt != before.doubt:
        yield f"not begun yet: {now.doubt.words}", "note"
    if now.error and now.error != before.error:
        yield now.error, "bad"
    if now.trouble and now.trouble != before.trouble:
        yield f"the arm can't be read: {now.trouble}", "bad"
    elif before.trouble and not now.trouble:
        yield "the arm is read again", "good"
    if now.n_lost > before.n_lost:
        yield f"{now.n_lost - before.n_lost} samples lost", "bad"


def _ended_words(ended: Ended) -> str:
    why = f", {ended.reason}" if ended.reason else ""
    return f"{ended.file or ended.trial}: {ended.outcome}{why}"
