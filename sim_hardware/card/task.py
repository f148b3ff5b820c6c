"""One task: its channels, its timing, its buffer and where it stands."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum

from sim_hardware.card.buffers import InputRing, OutputQueue
from sim_hardware.card.channels import Channel, Direction
from sim_hardware.card.errors import CardError, Code
from sim_hardware.card.plant import SAMPLE_RATE_HZ

FINITE = 10178
CONTINUOUS = 10123
DEFAULT_INPUT_BUFFER_SAMPLES = 10_000
DEFAULT_FINITE_SAMPLES = 1000


class State(Enum):
    """What a task holds: nothing, its channels, or its channels and the clock."""

    CONFIGURED = "configured"
    COMMITTED = "committed"
    RUNNING = "running"


@dataclass
class Timing:
    """Sample clock of a task: rate as granted, finite or continuous, samples a channel, clock terminal."""

    rate_hz: float = SAMPLE_RATE_HZ
    mode: int = FINITE
    n_samples: int = DEFAULT_FINITE_SAMPLES
    clock: str = ""


@dataclass
class CardTask:
    """A task as the driver keeps it; the card alone changes it, under its lock.

    timing is None for software-timed (on demand) tasks. first_sample is the card's sample on which the task's
    first one falls; None while it waits for its trigger or its clock.
    """

    name: str
    channels: list[Channel] = field(default_factory=list)
    timing: Timing | None = None
    start_trigger: str = ""
    regenerate: bool = True
    input_buffer_samples: int | None = None
    output_buffer_samples: int | None = None
    overwrite_mode: int = 10159
    read_all_available: bool = False
    state: State = State.CONFIGURED
    state_after_stop: State = State.CONFIGURED
    first_sample: int | None = None
    done: bool = False
    fault: int = 0
    fault_reported: bool = False
    ring: InputRing | None = None
    queue: OutputQueue | None = None

    @property
    def direction(self) -> Direction:
        """Direction of its channels; CardError (-200478) while it has none."""
        if not self.channels:
            raise CardError(Code.NO_CHANNELS)
        return self.channels[0].direction

    @property
    def running(self) -> bool:
        """Whether the task was started and not stopped (a finished generation runs until it is stopped)."""
        return self.state is State.RUNNING

    @property
    def clocked(self) -> bool:
        """Whether the sample clock drives it right now: started, triggered, not at its end, not failed."""
        return (
            self.running
            and not self.done
            and not self.fault
            and self.timing is not None
            and self.first_sample is not None
        )

    @property
    def finite(self) -> bool:
        """Whether the task ends by itself after timing.n_samples samples."""
        return self.timing is not None and self.timing.mode == FINITE

    @property
    def n_passed(self) -> int:
        """Samples a channel acquired or generated since the start."""
        if self.ring is not None:
            return self.ring.acquired
        return self.queue.generated if self.queue is not None else 0

    def n_left(self, wanted: int) -> int:
        """How many of `wanted` further samples the task still takes before its own end."""
        if self.timing is None or not self.finite:
            return wanted
        return min(wanted, self.timing.n_samples - self.n_passed)

    def need(self, direction: Direction) -> None:
        """Raise CardError unless the task has channels of this direction."""
        if not self.channels or self.channels[0].direction != direction:
            raise CardError(Code.NO_INPUT_CHANNELS if direction == "ai" else Code.NO_OUTPUT_CHANNELS)

    def add_channels(self, channels: Sequence[Channel]) -> None:
        """Add channels; CardError when running, on mixed directions, or when they are in the task already."""
        self.refuse_while_running()
        for channel in channels:
            if self.channels and self.direction != channel.direction:
                raise CardError(Code.MIXED_DIRECTIONS)
            if any(channel.name == other.name or channel.index == other.index for other in self.channels):
                raise CardError(Code.CHANNEL_TWICE, f"Channel: {channel.name}.")
            self.channels.append(channel)

    def refuse_while_running(self) -> None:
        """Raise CardError (-200479) on a change of configuration while the task runs."""
        if self.running:
            raise CardError(Code.RUNNING)

    def check(self) -> None:
        """Raise what stopped the task, if anything did."""
        if self.fault:
            self.fault_reported = True
            raise CardError(self.fault, f"Task Name: {self.name}.")

    def input_size(self) -> int:
        """Samples a channel in the acquisition's buffer: as set, else by the driver's rule of thumb."""
        if self.input_buffer_samples is not None:
            return self.input_buffer_samples
        if self.timing is None:
            return 0
        if self.finite:
            return self.timing.n_samples
        return max(self.timing.n_samples, DEFAULT_INPUT_BUFFER_SAMPLES)

    def output_size(self) -> int:
        """Samples a channel in the generation's buffer: as set, else what the first write made it, else 0."""
        if self.output_buffer_samples is not None:
            return self.output_buffer_samples
        return self.queue.size if self.queue is not None else 0
