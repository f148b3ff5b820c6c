"""Questions to a person: each has an id, and is answered or withdrawn once, at the console or by a message."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from rig.hardware.errors import OperatorError

_SLICE_S = 0.02
"""A stop is looked for so often while a question stands."""


@dataclass(frozen=True, slots=True)
class Prompt:
    """A question that stands: something to be done, or a number to be read off (`unit` says of what)."""

    id: str
    kind: str
    words: str
    wants: Literal["done", "number"] = "done"
    unit: str = ""
    suggested: float | None = None


class Desk:
    """Where the questions of a run lie until someone answers; `show` is told what stands, None for nothing.

    `ask` is called by the run's thread, `answer` by any. `asks_first`: a person is asked before a service
    that stands in for hands does something, so that a simulated bench can be worked by hand too.
    """

    def __init__(self, *, asks_first: bool = True) -> None:
        self.asks_first = asks_first
        self._standing: Prompt | None = None
        self._value: float | None = None
        self._cancelled = ""
        self._changed = threading.Condition()

    @property
    def standing(self) -> Prompt | None:
        """The question that waits for its answer."""
        return self._standing

    def ask(
        self,
        kind: str,
        words: str,
        *,
        check: Callable[[], None],
        show: Callable[[Prompt | None], None],
        suggested: float | None = None,
        unit: str = "",
    ) -> float | None:
        """Ask, and wait for the answer; with a `unit`, for a number, `suggested` where none is said.

        `check` is called between short waits and may raise. Raises OperatorError where the answer is that
        it can't be done.
        """
        wants: Literal["done", "number"] = "number" if unit else "done"
        prompt = Prompt(uuid.uuid4().hex[:12], kind, words, wants, unit, suggested)
        with self._changed:
            self._standing, self._value, self._cancelled = prompt, None, ""
        try:
            show(prompt)
            while True:
                check()
                with self._changed:
                    if self._changed.wait_for(lambda: self._standing is not prompt, _SLICE_S):
                        break
        finally:
            with self._changed:
                self._standing = None
            show(None)
        if self._cancelled:
            raise OperatorError(f"{kind}: {self._cancelled}; start the run again to go on where it was")
        return suggested if self._value is None else self._value

    def answer(self, prompt_id: str, value: float | None = None) -> str:
        """Say that it is done, or which number was read; return why not, where the answer can't be taken."""
        with self._changed:
            standing = self._standing
            if standing is None or standing.id != prompt_id:
                return "this question does not stand any more"
            if standing.wants == "number" and value is not None and not value >= 0:
                return f"{value:g} {standing.unit} can't be: give a number of 0 or more"
            self._value, self._standing = value, None
            self._changed.notify_all()
        return ""

    def cancel(self, prompt_id: str, reason: str = "the operator cancelled it") -> str:
        """Say that it can't be done, which ends the run; return why not, where that can't be taken."""
        with self._changed:
            if self._standing is None or self._standing.id != prompt_id:
                return "this question does not stand any more"
            self._cancelled, self._standing = reason, None
            self._changed.notify_all()
        return ""
