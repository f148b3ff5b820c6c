"""The card's sample clock: plays outputs into the world, samples its answer, and lets time pass.

Whoever looks first brings the world up to now, so nobody can tell whether it was advanced in the background
or just in time.
"""

import heapq
import itertools
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from sim_hardware.card.channels import N_CHANNELS
from sim_hardware.card.clock import RealClock, SampleClock, VirtualClock
from sim_hardware.card.errors import Code
from sim_hardware.card.plant import SAMPLE_RATE_HZ, FloatArray, Plant
from sim_hardware.card.task import CardTask
from sim_hardware.card.wires import Wire
from sim_hardware.world.converters import Converter

LARGEST_BLOCK = 8192
BACKGROUND_PERIOD_S = 0.02
LONGEST_NAP_S = 60.0
OPEN_INPUT_NOISE_V = 0.3e-3

Wires = tuple[FloatArray, FloatArray, FloatArray]
"""Volts of the position and force sensors and of AO0, (n,) each."""


class Timebase:
    """One clock. AO0 drives the plant, AI0 and AI1 read it, AI2 hears AO0 where that is wired.

    Outputs keep their last value whatever happens to a task, its client or the device. Open inputs are noisy.
    """

    def __init__(
        self,
        plant: Plant,
        *,
        virtual: bool,
        loopback_wired: bool,
        initial_command_v: float,
        converter: Converter,
        seed: int,
    ) -> None:
        self.plant = plant
        self.tasks: dict[str, CardTask] = {}
        self.n_samples = 0
        self.converter = converter
        self.output_v = np.zeros(N_CHANNELS["ao"])
        self.output_v[0] = converter.convert(np.array(initial_command_v))
        self._loopback_wired = loopback_wired
        self.wires: dict[int, Wire] = {}
        """Faulty wires, by the number of the input."""
        self._noise = np.random.default_rng((seed, 0xA12))
        self._latest = (np.zeros(1), np.zeros(1), np.zeros(1))
        self._orders: list[tuple[float, int, Callable[[], None]]] = []
        self._order_numbers = itertools.count()
        self._changed = threading.Condition(threading.RLock())
        self._closing = threading.Event()
        self._background: threading.Thread | None = None
        self._step(1)  # whatever is slow the first time is slow before the clock starts
        self.clock: SampleClock = VirtualClock() if virtual else RealClock(self.n_samples)

    def start_background(self) -> None:
        """Advance the world also while nobody asks (real time only)."""
        if not self.clock.virtual:
            self._background = threading.Thread(target=self._run_background, name="card clock", daemon=True)
            self._background.start()

    def close(self) -> None:
        """End the background thread."""
        self._closing.set()
        if self._background is not None:
            self._background.join()

    def _run_background(self) -> None:
        while not self._closing.wait(BACKGROUND_PERIOD_S):
            with self._changed:
                if self.clock.n_due() - self.n_samples > BACKGROUND_PERIOD_S * SAMPLE_RATE_HZ / 2:
                    self._catch_up()

    def held(self) -> threading.Condition:
        """Hold the card as it is."""
        return self._changed

    @contextmanager
    def at_now(self) -> Iterator[None]:
        """Hold the card, with the world brought up to now."""
        with self._changed:
            self._catch_up()
            yield

    def _catch_up(self) -> None:
        behind = self.clock.n_due() - self.n_samples
        if behind > SAMPLE_RATE_HZ and self._timed("ai") is None and self._timed("ao") is None:
            self.plant.rest(behind / SAMPLE_RATE_HZ)  # the computer slept; nobody was sampling
            self.n_samples += behind
        elif behind > 0:
            self._advance(behind)

    def at_time(self, time_s: float, action: Callable[[], None]) -> None:
        """Order `action` for a time of the bench; it falls between two samples."""
        with self._changed:
            heapq.heappush(self._orders, (time_s, next(self._order_numbers), action))

    def _advance(self, n: int) -> None:
        """Let n samples pass."""
        while n > 0:
            n -= self._step(int(min(n, LARGEST_BLOCK, self._n_to_order())))
        self._n_to_order()

    def _n_to_order(self) -> float:
        """Carry out the orders that are due; samples until the next one, infinity where there is none."""
        while self._orders:
            ahead = math.ceil((self._orders[0][0] - self.plant.time_s) * SAMPLE_RATE_HZ - 1e-6)
            if ahead > 0:
                return ahead
            heapq.heappop(self._orders)[2]()
        return math.inf

    def _step(self, block: int) -> int:
        """Let at most `block` samples pass under unchanged tasks; how many did."""
        playing, acquiring = self._timed("ao"), self._timed("ai")
        if acquiring is not None:
            block = acquiring.n_left(block)  # what this acquisition clocks ends with it, on the sample
        command_v = self._play(playing, acquiring, block)
        readings = self.plant.advance(command_v)
        self._acquire(acquiring, (readings.position_v, readings.force_v, command_v))
        self.n_samples += block
        return block

    def _timed(self, direction: str) -> CardTask | None:
        """The task that the sample clock drives in this direction, if any."""
        for task in self.tasks.values():
            if task.clocked and task.direction == direction:
                return task
        return None

    def _play(self, task: CardTask | None, acquiring: CardTask | None, block: int) -> FloatArray:
        """Command of the next samples, shape (block,): what the task plays, held before and after."""
        command_v = np.full(block, self.output_v[0])
        if task is None or task.queue is None or task.timing is None or task.first_sample is None:
            return command_v
        if task.timing.clock == "ai/SampleClock" and acquiring is None:
            return command_v
        lead = max(0, task.first_sample - self.n_samples)
        if lead >= block:
            return command_v
        wanted = task.n_left(block - lead)
        played = task.queue.take(wanted)
        n_played = played.shape[1]
        for row, channel in enumerate(task.channels):
            if n_played and channel.index == 0:
                command_v[lead : lead + n_played] = played[row]
                command_v[lead + n_played :] = played[row, -1]
            if n_played:
                self.output_v[channel.index] = played[row, -1]
        if n_played < wanted:
            self._fail(task, Code.OUTPUT_STARVED)
        elif task.finite and task.n_left(1) == 0:
            task.done = True
        return command_v

    def _acquire(self, task: CardTask | None, wires: Wires) -> None:
        """Put one block of what is on the wires into the buffer of the acquisition."""
        self._latest = (wires[0][-1:], wires[1][-1:], wires[2][-1:])
        if task is not None and task.ring is not None:
            task.ring.store(np.stack([self._hear(channel.index, wires) for channel in task.channels]))
            if task.finite and task.n_left(1) == 0:
                task.done = True

    def _hear(self, index: int, wires: Wires) -> FloatArray:
        """What an input reads; the outputs' voltages are on the converters' grid already."""
        if index < 2 or (index == 2 and self._loopback_wired):
            wire = self.wires.get(index)
            return wires[index] if wire is None else self.converter.convert(wire.read(wires[index]))
        return self.converter.convert(self._noise.normal(0.0, OPEN_INPUT_NOISE_V, len(wires[0])))

    def _fail(self, task: CardTask, code: int) -> None:
        task.fault, task.fault_reported, task.done = int(code), False, True
        self._changed.notify_all()

    def wait(self, n_missing: Callable[[], int | None], timeout_s: float) -> bool:
        """Let time pass until n_missing() is 0; False when timeout_s (negative: endless) ends before that.

        n_missing tells how many samples are still to come, None if no number of samples would help.
        """
        deadline_s = math.inf if timeout_s < 0 else time.monotonic() + timeout_s
        left = math.inf if timeout_s < 0 else round(timeout_s * SAMPLE_RATE_HZ)
        with self._changed:
            while (missing := n_missing()) != 0:
                if self.clock.virtual:
                    if left == 0 or (missing is None and math.isinf(left)):
                        return False
                    # not beyond an order: it may change what is waited for
                    step = int(min(left, missing or LARGEST_BLOCK, self._n_to_order()))
                    self._advance(step)
                    left -= step
                    continue
                patience_s = deadline_s - time.monotonic()
                if missing is not None:
                    patience_s = min(patience_s, self.clock.seconds_until(self.n_samples + missing))
                if patience_s > 0:
                    self._changed.wait(min(patience_s, LONGEST_NAP_S))
                self._catch_up()
                if time.monotonic() >= deadline_s:
                    return n_missing() == 0
            return True

    def sleep(self, duration_s: float) -> None:
        """Let bench time pass: really, or by a jump; running tasks see the samples of a jump go by."""
        if not self.clock.virtual:
            time.sleep(duration_s)
            return
        with self._changed:
            if self._timed("ai") is None and self._timed("ao") is None:
                self.plant.rest(duration_s)
            else:
                self._advance(round(duration_s * SAMPLE_RATE_HZ))

    def input_now(self, indices: list[int]) -> FloatArray:
        """Volts on these inputs at the latest sample, shape (len(indices),)."""
        return np.array([self._hear(index, self._latest)[0] for index in indices])

    def set_outputs(self, volts: dict[int, float]) -> None:
        """Put outputs to a value at once; in virtual time the value lasts at least one sample."""
        with self.at_now():
            for index, value in volts.items():
                self.output_v[index] = value
            if self.clock.virtual:
                self._advance(1)

    def now_s(self) -> float:
        """Time of the bench."""
        with self.at_now():
            return self.plant.time_s
