"""The card as its driver shows it: tasks are made, reserved, started, stopped; faults come to order."""

import math
import time
from collections.abc import Sequence

from sim_hardware.card.buffers import InputRing
from sim_hardware.card.channels import DEVICE, Channel, check_device, parse_terminal
from sim_hardware.card.errors import CardError, Code
from sim_hardware.card.plant import SAMPLE_RATE_HZ, Plant
from sim_hardware.card.task import CONTINUOUS, FINITE, CardTask, State, Timing
from sim_hardware.card.timebase import Timebase
from sim_hardware.settings import ConverterSettings
from sim_hardware.world.converters import Converter


class Card(Timebase):
    """A multifunction card; see `transfer` for its reads and writes."""

    def __init__(
        self,
        plant: Plant,
        *,
        virtual: bool,
        loopback_wired: bool = True,
        late_start_samples: int = 0,
        initial_command_v: float = 0.0,
        converter: Converter | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__(
            plant,
            virtual=virtual,
            loopback_wired=loopback_wired,
            initial_command_v=initial_command_v,
            converter=converter or Converter(ConverterSettings()),
            seed=seed,
        )
        self.present = True
        self.late_start_samples = late_start_samples
        self.coerced_rate_hz: float | None = None
        self._stalled_until_s = 0.0
        self._pending_stall_s = 0.0

    def close(self) -> None:
        """Switch the card off: calls that wait come back with an error."""
        super().close()
        with self._changed:
            for task in self.tasks.values():
                self._abort(task)

    # ---- faults to order

    def attend(self) -> None:
        """Wait while the host is stalled; calls pass here when they come in and before they are answered."""
        with self._changed:
            stall_s, self._pending_stall_s = self._pending_stall_s, 0.0
            if stall_s:
                self._advance(round(stall_s * SAMPLE_RATE_HZ))
        while (wait_s := self._stalled_until_s - time.monotonic()) > 0 and not self._closing.wait(wait_s):
            pass

    def stall(self, duration_s: float) -> None:
        """Serve no call for this long while the card's clock runs on."""
        with self._changed:
            if self.clock.virtual:
                self._pending_stall_s += duration_s
            else:
                self._stalled_until_s = time.monotonic() + duration_s

    def unplug(self) -> None:
        """Take the card out of the computer: what runs fails with -201003, what is created with -200220."""
        with self._changed:
            self.present = False
            for task in self.tasks.values():
                self._fail(task, Code.DEVICE_GONE)

    def replug(self) -> None:
        """Put the card back; tasks from before stay failed."""
        with self._changed:
            self.present = True

    # ---- making tasks

    def create(self, name: str) -> CardTask:
        """A new, empty task."""
        with self._changed:
            task = self.tasks[name] = CardTask(name)
            return task

    def clear(self, task: CardTask) -> None:
        """Abort the task and forget it; outputs stay where they are."""
        with self.at_now():
            self._abort(task)
            self.tasks.pop(task.name, None)

    def add_channels(self, task: CardTask, channels: Sequence[Channel]) -> None:
        """Add voltage channels to the task."""
        with self._changed:
            if not self.present:
                raise CardError(Code.NO_SUCH_DEVICE, f"Device Specified: {DEVICE}.")
            task.add_channels(channels)

    def set_timing(self, task: CardTask, asked: Timing) -> None:
        """Give the task a sample clock; the card has one rate, 8000 Hz, and coerces every other to it."""
        with self._changed:
            task.refuse_while_running()
            if not task.channels:
                raise CardError(Code.NO_CHANNELS)
            if not (math.isfinite(asked.rate_hz) and asked.rate_hz > 0):
                raise CardError(Code.INVALID_VALUE, f"Sample Clock Rate: {asked.rate_hz}.")
            if asked.mode not in {FINITE, CONTINUOUS}:
                raise CardError(Code.INVALID_VALUE, "Hardware-timed single point is not available.")
            if asked.mode == FINITE and asked.n_samples < 1:
                raise CardError(Code.INVALID_VALUE, f"Samples per Channel: {asked.n_samples}.")
            task.timing = Timing(
                self.coerced_rate_hz or SAMPLE_RATE_HZ,
                asked.mode,
                asked.n_samples,
                parse_terminal(asked.clock),
            )

    def set_start_trigger(self, task: CardTask, source: str) -> None:
        """Let the task start on an edge at a terminal, or (empty) at once."""
        with self._changed:
            task.refuse_while_running()
            task.start_trigger = parse_terminal(source)

    # ---- running tasks

    def reserve(self, task: CardTask) -> None:
        """Take the channels and the clock for this task; CardError (-50103) if another holds them."""
        if not self.present:
            raise CardError(Code.DEVICE_GONE)
        for other in self.tasks.values():
            if other is task or other.state is State.CONFIGURED or other.direction != task.direction:
                continue
            shared = {c.index for c in other.channels} & {c.index for c in task.channels}
            if shared or (other.timing is not None and task.timing is not None):
                raise CardError(
                    Code.RESOURCE_RESERVED, f"Task Name: {task.name}. Conflicting Task: {other.name}."
                )
        if task.state is State.CONFIGURED:
            task.state = State.COMMITTED

    def start(self, task: CardTask) -> None:
        """Start the task on its trigger, or at the next sample."""
        with self.at_now():
            task.check()
            task.refuse_while_running()
            queue = task.queue
            if task.direction == "ao" and task.timing is not None and (queue is None or not queue.written):
                raise CardError(Code.OUTPUT_EMPTY, f"Task Name: {task.name}.")
            task.state_after_stop = task.state
            self.reserve(task)
            if task.direction == "ai" and task.timing is not None:
                task.ring = InputRing(len(task.channels), max(1, task.input_size()))
            if queue is not None:
                queue.regenerate = task.regenerate
            task.state, task.done, task.first_sample = State.RUNNING, False, None
            needs_ai_clock = task.timing is not None and task.timing.clock == "ai/SampleClock"
            if not task.start_trigger and not (needs_ai_clock and self._timed("ai") is None):
                self._begin(task)

    def _begin(self, task: CardTask) -> None:
        """Let a started task begin with the next sample, and pull the tasks that wait for this one."""
        late = self.late_start_samples if task.direction == "ao" else 0
        task.first_sample = self.n_samples + late
        if task.timing is None:
            return
        for other in self.tasks.values():
            if other.running and other.first_sample is None:
                clock = other.timing.clock if other.timing is not None else ""
                if (other.start_trigger or clock) in {
                    f"{task.direction}/StartTrigger",
                    f"{task.direction}/SampleClock",
                }:
                    self._begin(other)

    def stop(self, task: CardTask) -> None:
        """Stop the task; reports, once, what had stopped it before."""
        with self.at_now():
            if not task.running:
                return
            unreported = 0 if task.fault_reported else task.fault
            self._halt(task)
            task.state = task.state_after_stop
            if unreported:
                raise CardError(unreported, f"Task Name: {task.name}.")

    def abort(self, task: CardTask) -> None:
        """Stop the task at once and release what it holds."""
        with self.at_now():
            self._abort(task)

    def reset(self, device: str) -> None:
        """Abort every task; the outputs of this card keep their voltage all the same."""
        with self.at_now():
            check_device(device)
            if not self.present:
                raise CardError(Code.NO_SUCH_DEVICE, f"Device Specified: {device}.")
            for task in self.tasks.values():
                self._abort(task)

    def _abort(self, task: CardTask) -> None:
        self._halt(task)
        task.state = State.CONFIGURED
        task.queue = None

    def _halt(self, task: CardTask) -> None:
        task.first_sample, task.done = None, True
        if task.queue is not None:
            task.queue.rewind()
        if task.fault != Code.DEVICE_GONE:
            task.fault = 0
        self._changed.notify_all()

    def is_done(self, task: CardTask) -> bool:
        """Whether the task has come to its end; CardError if something stopped it."""
        with self.at_now():
            task.check()
            return task.done or not task.running

    def wait_until_done(self, task: CardTask, timeout_s: float) -> None:
        """Wait for the end of the task; CardError (-200560) when it does not come in time."""

        def n_missing() -> int | None:
            task.check()
            if task.done or not task.running:
                return 0
            if task.first_sample is None or task.timing is None:
                return None
            lead = max(0, task.first_sample - self.n_samples)
            if task.finite:
                return lead + task.timing.n_samples - task.n_passed
            if task.queue is not None and not task.queue.regenerate:
                return lead + task.queue.written - task.queue.generated + 1
            return None

        if not self.wait(n_missing, timeout_s):
            raise CardError(Code.NOT_DONE, f"Task Name: {task.name}.")
