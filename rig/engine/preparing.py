"""What is done before a recording: hands, stage, weights, and the finger's rest."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from rig.engine.bench import Bench
from rig.engine.control import Control
from rig.engine.progress import clock_words
from rig.engine.prompts import Prompt
from rig.engine.states import State
from rig.hardware.errors import OperatorError
from rig.hardware.operator import Details, words_for
from rig.protocols.steps import Ask, MoveStage, Preparation, Rest, WeighMass

_SLICE_S = 0.05
"""A rest passes in slices of this wall time, so that it can be shown and stopped; a bench whose clock outruns
the wall's gets longer ones."""

_SAY_EVERY_S = 1.0

_SHORTEST_S = 1e-3
"""What is left of a rest below this is none: a clock that counts samples may not move at all."""


@dataclass(slots=True)
class Prepared:
    """What a preparation brought to light: what was done, in a few words each, and the mass that hangs."""

    words: list[str]
    mass_g: float | None = None


class Preparations:
    """Does the steps before a recording; what stands already is not asked for again.

    `enter` is told the state, `spend` the bench time used, `say` the words to show, `show_rest` the rest that
    is left, s, `show_prompt` the question that stands. `idle` is called between two slices of any wait.
    """

    def __init__(
        self,
        bench: Bench,
        control: Control,
        *,
        enter: Callable[[State], None],
        spend: Callable[[float], None],
        say: Callable[[str], None],
        show_rest: Callable[[float], None],
        show_prompt: Callable[[Prompt | None], None],
        idle: Callable[[], None],
    ) -> None:
        self._bench = bench
        self._control = control
        self._interrupts = control.interrupts
        self._show_rest = show_rest
        self._show_prompt = show_prompt
        self._idle = idle
        self._enter = enter
        self._spend = spend
        self._say = say
        self._ended_s: float | None = None
        self._below: Ask | None = None
        self._stage_um: float | None = None
        self._homed = False

    def do(self, steps: tuple[Preparation, ...]) -> Prepared:
        """Do the steps in order."""
        prepared = Prepared([])
        for step in steps:
            if isinstance(step, Rest):
                self._rest(step)
            elif not self._stands(step):
                self._by_hand(step, prepared)
                self._spend(step.expected_s)
        return prepared

    def _stands(self, step: Ask | MoveStage | WeighMass) -> bool:
        """Whether the bench is already as a step wants it."""
        if isinstance(step, MoveStage):
            before, self._stage_um = self._stage_um, step.position_um
            return before == step.position_um
        if isinstance(step, Ask):
            last, self._below = self._below, step
            return last is not None and (last.request, last.details) == (step.request, step.details)
        return False

    def indentation_ended(self) -> None:
        """Remember that an indentation has just ended: from now the finger rests."""
        self._ended_s = self._bench.clock.time_s()

    def rested_s(self) -> float | None:
        """Return the time since the previous indentation of this run ended, s; None before the first."""
        return None if self._ended_s is None else self._bench.clock.time_s() - self._ended_s

    def pause(self) -> None:
        """Wait while the run is to pause; raises what ends the wait otherwise."""
        if not self._control.pausing():
            return
        self._enter(State.PAUSED)
        self._say("paused")
        while self._control.pausing():
            self._look()
            time.sleep(_SLICE_S)
        self._say("")
        self._enter(State.PREPARING)

    def _by_hand(self, step: Ask | MoveStage | WeighMass, prepared: Prepared) -> None:
        self._enter(State.PREPARING)
        self._control.check()
        match step:
            case Ask():
                prepared.words.append(self._ask(step.request, step.details))
            case MoveStage():
                prepared.words.append(self._move_stage(step.position_um))
            case WeighMass():
                self._hang(step.mass_g, prepared)

    def _ask(self, request: str, details: Details) -> str:
        """Have something done: by a person, by a service in the place of hands, or by one after the other."""
        words = words_for(request, details)
        self._say(words)
        hands, desk = self._bench.operator, self._control.desk
        if desk is not None and (hands is None or desk.asks_first):
            desk.ask(request, words, check=self._look, show=self._show_prompt)
        if hands is not None:
            with self._interrupts.waiting():
                return hands.request(request, details)
        if desk is None:
            raise OperatorError(
                f"{request}: nobody is there to answer; run in a terminal, or name a service under "
                "[operator] in rig.toml"
            )
        return "done by hand"

    def _look(self) -> None:
        """What is done between two slices of a wait."""
        self._control.check()
        self._idle()

    def _move_stage(self, position_um: float) -> str:
        if self._bench.stage is None:
            return self._ask("turn_micrometer", {"position_um": position_um})
        with self._interrupts.waiting():
            if not self._homed:
                self._say("Z stage to its reference")
                self._bench.stage.home()
                self._homed = True
            self._say(f"Z stage to {position_um:g} um")
            self._bench.stage.move_to_um(position_um)
        return f"stage at {position_um:g} um"

    def _hang(self, mass_g: float, prepared: Prepared) -> None:
        """Hang a weight, after the balance, where there is one, has said what it really is."""
        prepared.mass_g = mass_g
        balance = self._bench.balance
        if balance is not None and mass_g > 0:
            self._ask("place_on_balance", {"mass_g": mass_g})
            with self._interrupts.waiting():
                prepared.mass_g = balance.weigh_g()
            self._ask("place_on_balance", {"mass_g": 0.0})
            prepared.words.append(f"the weight of {mass_g:g} g weighs {prepared.mass_g:.4f} g")
        elif self._bench.operator is None and self._control.desk is not None and mass_g > 0:
            words = f"Weigh the weight of {mass_g:g} g, and give its mass"
            self._say(words)
            prepared.mass_g = self._control.desk.ask(
                "weigh", words, check=self._look, show=self._show_prompt, suggested=mass_g, unit="g"
            )
        prepared.words.append(self._ask("hang_weight", {"mass_g": mass_g}))

    def _rest(self, step: Rest) -> None:
        self._enter(State.RESTING)
        clock = self._bench.clock
        since_s = self.rested_s()
        left_s = step.since_last_s - (since_s or 0.0)
        slice_s, said_s = _SLICE_S, float("inf")
        while left_s > _SHORTEST_S and not self._control.rest_skipped:
            if said_s - left_s >= _SAY_EVERY_S:
                said_s = left_s
                self._show_rest(left_s)
                self._say(f"resting, {clock_words(left_s)} left")
            self._look()
            wall = time.monotonic()
            before_s = clock.time_s()
            clock.sleep(min(slice_s, left_s))
            passed_s = clock.time_s() - before_s
            # a clock that outruns the wall's, of a simulated bench, need not be asked twenty times a second
            if time.monotonic() - wall < 0.5 * min(slice_s, _SLICE_S):
                slice_s *= 4
            self._spend(passed_s)
            left_s -= passed_s
        self._show_rest(0.0)
