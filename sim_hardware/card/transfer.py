"""Reads and writes: samples between a task's buffer and its client."""

import numpy as np

from sim_hardware.card.buffers import OutputQueue
from sim_hardware.card.card import Card
from sim_hardware.card.errors import CardError, Code
from sim_hardware.card.plant import FloatArray
from sim_hardware.card.task import CardTask


class ShortReadError(CardError):
    """A read that timed out (-200284) with what had come by then in `partial`, shape (n_channels, n_read)."""

    def __init__(self, partial: FloatArray, task_name: str) -> None:
        super().__init__(Code.NOT_YET_AVAILABLE, f"Task Name: {task_name}.", n_read=partial.shape[1])
        self.partial = partial


def read(card: Card, task: CardTask, n: int, timeout_s: float) -> FloatArray:
    """The next n samples in volts, shape (n_channels, n), waiting for those still to come.

    A task not yet started is started. Raises ShortReadError (-200284) when they do not come in time,
    CardError -200279 when the buffer has run over, -200278 past a finite end, or whatever stopped the task.
    """
    with card.held():
        task.need("ai")
        task.check()
        if task.timing is None:
            return _read_on_demand(card, task, n)
        if not task.running:
            card.start(task)
        ring = task.ring
        assert ring is not None
        if task.finite and n > task.timing.n_samples - ring.read_position:
            raise CardError(Code.NEVER_AVAILABLE, f"Task Name: {task.name}.", n_read=0)
        out = np.empty((len(task.channels), n))
        filled = 0

        def n_missing() -> int | None:
            nonlocal filled
            task.check()
            if task.ring is not ring or not task.running:
                raise CardError(Code.TASK_ABORTED, f"Task Name: {task.name}.", n_read=filled)
            if ring.overwritten:
                raise CardError(Code.OVERWRITTEN, f"Task Name: {task.name}.", n_read=filled)
            taken = min(n - filled, ring.available)
            if taken:
                out[:, filled : filled + taken] = ring.take(taken)
                filled += taken
            if filled == n:
                return 0
            return None if task.first_sample is None else min(n - filled, max(1, ring.size // 2))

        if not card.wait(n_missing, timeout_s):
            raise ShortReadError(out[:, :filled], task.name)
        return out


def _read_on_demand(card: Card, task: CardTask, n: int) -> FloatArray:
    """n samples taken one after the other, now, shape (n_channels, n)."""
    state = task.state
    card.reserve(task)
    columns = []
    for _ in range(n):
        target = card.n_samples + 1
        card.wait(lambda target=target: max(0, target - card.n_samples), 10.0)  # type: ignore[misc]
        columns.append(card.input_now([channel.index for channel in task.channels]))
    task.state = state
    return np.stack(columns, axis=1)


def write(card: Card, task: CardTask, samples: FloatArray, *, auto_start: bool, timeout_s: float) -> int:
    """Queue samples in volts, shape (n_channels, n), or set the outputs of an on-demand task; how many went.

    The first write makes the buffer, unless its size was set. Waits for room; CardError -200292 (with
    n_written) when there is none in time, -200561 outside a channel's range, -200290 after starving.
    """
    with card.at_now():
        task.need("ao")
        task.check()
        for row, channel in enumerate(task.channels):
            within = (samples[row] >= channel.min_v - 1e-9) & (samples[row] <= channel.max_v + 1e-9)
            if not np.all(within):
                raise CardError(
                    Code.OUTPUT_OUT_OF_RANGE,
                    f"Range: {channel.min_v} to {channel.max_v} V. Channel: {channel.name}.",
                    n_written=0,
                )
        samples = card.converter.convert(samples)
        if task.timing is None:
            return _write_on_demand(card, task, samples, auto_start=auto_start)
        n: int = samples.shape[1]
        card.reserve(task)
        if task.queue is None:
            size = task.output_buffer_samples or n
            task.queue = OutputQueue(len(task.channels), size, regenerate=task.regenerate)
        queue = task.queue
        written = 0

        def n_missing() -> int | None:
            nonlocal written
            task.check()
            put = min(n - written, queue.room)
            if put:
                queue.write(samples[:, written : written + put])
                written += put
            if written == n:
                return 0
            if task.first_sample is None or task.done:
                return None
            return min(n - written, max(1, queue.size // 2))

        if not card.wait(n_missing, timeout_s if task.running else 0.0):
            raise CardError(Code.NOT_YET_WRITABLE, f"Task Name: {task.name}.", n_written=written)
        if auto_start and not task.running:
            card.start(task)
        return written


def _write_on_demand(card: Card, task: CardTask, samples: FloatArray, *, auto_start: bool) -> int:
    """Put the outputs to each value in turn; in virtual time each of them lasts one sample."""
    if not task.running:
        if not auto_start:
            raise CardError(Code.NOT_YET_WRITABLE, "The task is not started.", n_written=0)
        card.start(task)
    for column in samples.T:
        card.set_outputs({channel.index: value for channel, value in zip(task.channels, column, strict=True)})
    n: int = samples.shape[1]
    return n
