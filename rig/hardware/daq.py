"""The card in volts and samples: the only file that speaks nidaqmx.

The same calls reach a card in this computer (address "") and one behind NI's gRPC device server
(address "host:port"); every error becomes one of the program's own, with NI's code and what to do.
"""

from __future__ import annotations

import contextlib
import logging
import os
import platform
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Self

import grpc
import nidaqmx
import numpy as np
from nidaqmx.constants import AcquisitionType, Edge, RegenerationMode, TerminalConfiguration
from nidaqmx.errors import DaqError, DaqNotFoundError, DaqNotSupportedError, DaqReadError, DaqWriteError
from nidaqmx.errors import Error as NidaqmxError
from nidaqmx.errors import RpcError as NidaqmxRpcError
from nidaqmx.grpc_session_options import GrpcSessionOptions, SessionInitializationBehavior
from nidaqmx.stream_readers import AnalogMultiChannelReader
from nidaqmx.stream_writers import AnalogSingleChannelWriter
from numpy.typing import NDArray

from rig.hardware.card_server import open_channel
from rig.hardware.errors import CardError, CardMissingError, RateCoercedError
from rig.hardware.remedies import remedy_for_code, remedy_for_server
from rig.settings.rig_file import TlsSettings

FloatArray = NDArray[np.float64]

_log = logging.getLogger(__name__)

_WRITE_TIMEOUT_S = 1.0
"""A piece of a stream always finds room; a card that takes none for so long does not play."""

_WRITE_BLOCK = 8000
"""Samples sent at a time: packing them takes under a millisecond, in which no sample can be fetched."""


@contextlib.contextmanager
def _as_own_errors(doing: str) -> Iterator[None]:
    try:
        yield
    except DaqError as error:
        raise _from_daq_error(error, doing) from error
    except NidaqmxRpcError as error:
        kind, remedy = remedy_for_server(error.rpc_code)
        raise kind(f"{doing}: {_first_line(error.description)}; {remedy}") from error
    except (DaqNotFoundError, DaqNotSupportedError) as error:
        raise CardMissingError(
            f"{doing}: no NI-DAQmx driver on this computer; install it, or set card.address in rig.toml"
        ) from error
    except (NidaqmxError, grpc.RpcError) as error:
        raise CardError(f"{doing}: {_first_line(str(error))}; check the card, then run again") from error


def _from_daq_error(error: DaqError, doing: str) -> CardError:
    code = int(error.error_code)
    kind, remedy = remedy_for_code(code)
    done = None
    if isinstance(error, DaqReadError):
        done = int(error.samps_per_chan_read)
    elif isinstance(error, DaqWriteError):
        done = int(error.samps_per_chan_written)
    return kind(f"{doing}: NI-DAQmx {code}: {_first_line(str(error))}; {remedy}", code, done)


def _first_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[0].rstrip(". ") if lines else "no reason given"


class Card:
    """One card; a context manager that closes the way to it. Tasks are named after ``owner``."""

    def __init__(
        self, address: str, device: str, owner: str = "indenter", tls: TlsSettings | None = None
    ) -> None:
        self.device = device
        # of this computer: another one's tasks on the same server are not this one's to end
        self._owner = f"{owner}-{platform.node() or 'here'}"
        self._channel: grpc.Channel | None = None
        if address:
            self._channel = open_channel(address, tls)
        self.where = f"card {device} at {address}" if address else f"card {device}"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection to the card's server, if there is one."""
        if self._channel is not None:
            self._channel.close()

    def connect(self) -> None:
        """Connect and load the driver now (0.2 s), so that the next call does not wait for it."""
        name = f"{self._task_name('connect')}-{os.getpid()}"
        with _as_own_errors(f"{self.where}: connecting"):
            self._open_task(name).close()

    def open_input(
        self, channels: Sequence[str], *, rate_hz: float, range_v: float, buffer_samples: int
    ) -> CardInput:
        """Prepare continuous sampling of ``channels`` ("ai0", ...), all at the same instants.

        Raises RateCoercedError where the card would sample at another rate.
        """
        doing = f"{self.where}: preparing the inputs {', '.join(channels)}"
        task = self._new_task("ai", doing)
        with _clearing_on_error(task), _as_own_errors(doing):
            for channel in channels:
                task.ai_channels.add_ai_voltage_chan(
                    f"{self.device}/{channel}",
                    terminal_config=TerminalConfiguration.DEFAULT,
                    min_val=-range_v,
                    max_val=range_v,
                )
            task.timing.cfg_samp_clk_timing(
                rate_hz, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=buffer_samples
            )
            task.in_stream.input_buf_size = buffer_samples
            _refuse_coerced(task, rate_hz, doing)
        return CardInput(task, len(channels), self.where)

    def open_output(
        self,
        channel: str,
        volts: FloatArray,
        *,
        rate_hz: float,
        range_v: float,
        on_input_start: bool = False,
        alive: Callable[[], None] = lambda: None,
    ) -> CardOutput:
        """Load a whole finite waveform, volts (n,), one value a sample, played once when started.

        With ``on_input_start`` it waits, once started, for the inputs' start trigger. ``alive`` is called
        between the calls to the card.
        """
        doing = f"{self.where}: loading {len(volts)} samples for {channel}"
        task = self._new_task("ao", doing)
        with _clearing_on_error(task), _as_own_errors(doing):
            alive()
            task.ao_channels.add_ao_voltage_chan(
                f"{self.device}/{channel}", min_val=-range_v, max_val=range_v
            )
            alive()
            task.timing.cfg_samp_clk_timing(
                rate_hz, sample_mode=AcquisitionType.FINITE, samps_per_chan=len(volts)
            )
            alive()
            task.out_stream.output_buf_size = len(volts)
            task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
            if on_input_start:
                task.triggers.start_trigger.cfg_dig_edge_start_trig(
                    f"/{self.device}/ai/StartTrigger", trigger_edge=Edge.RISING
                )
            alive()
            _refuse_coerced(task, rate_hz, doing)
            writer = AnalogSingleChannelWriter(task.out_stream, auto_start=False)
            writer.verify_array_shape = False  # one channel, one row: no need to ask the card
            for start in range(0, len(volts), _WRITE_BLOCK):
                writer.write_many_sample(np.ascontiguousarray(volts[start : start + _WRITE_BLOCK]))
        return CardOutput(task, self.where)

    def open_stream(
        self,
        channel: str,
        volts: FloatArray,
        *,
        rate_hz: float,
        range_v: float,
        buffer_samples: int,
        alive: Callable[[], None] = lambda: None,
    ) -> CardStream:
        """Load the beginning of a waveform, volts (n,), that plays on only while more of it is written in time.

        What was written is all that the card can play (nothing is played twice): an output that runs dry
        stops, holds its last voltage, and the next call says so (-200290, -200621).
        """
        doing = f"{self.where}: loading the first {len(volts)} samples for {channel}"
        task = self._new_task("ao", doing)
        with _clearing_on_error(task), _as_own_errors(doing):
            alive()
            task.ao_channels.add_ao_voltage_chan(
                f"{self.device}/{channel}", min_val=-range_v, max_val=range_v
            )
            alive()
            task.timing.cfg_samp_clk_timing(
                rate_hz, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=buffer_samples
            )
            alive()
            task.out_stream.output_buf_size = buffer_samples
            task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
            alive()
            _refuse_coerced(task, rate_hz, doing)
        stream = CardStream(task, self.where)
        with _clearing_on_error(task):
            stream.write(volts)
        return stream

    def clear_left_over_tasks(self) -> None:
        """Take the card from a program that died: end the tasks it left on the card's server.

        A driver in this computer has freed them with the process; a server keeps them. The output
        keeps its last voltage.
        """
        if self._channel is None:
            return
        for which in ("ao", "ai"):
            name = self._task_name(which)
            options = GrpcSessionOptions(
                self._channel,
                name,
                initialization_behavior=SessionInitializationBehavior.ATTACH_TO_SERVER_SESSION,
            )
            try:
                nidaqmx.Task(name, grpc_options=options).close()
            except (DaqError, NidaqmxRpcError) as error:
                # most often there is none; if the card is still held, opening the new task says so
                _log.info("no task %s to end: %s", name, _first_line(str(error)))

    def _task_name(self, which: str) -> str:
        return f"{self._owner}-{self.device}-{which}"

    def _new_task(self, which: str, doing: str) -> nidaqmx.Task:
        with _as_own_errors(doing):
            return self._open_task(self._task_name(which))

    def _open_task(self, name: str) -> nidaqmx.Task:
        if self._channel is None:
            return nidaqmx.Task(name)
        options = GrpcSessionOptions(
            self._channel,
            name,
            initialization_behavior=SessionInitializationBehavior.INITIALIZE_SERVER_SESSION,
        )
        return nidaqmx.Task(name, grpc_options=options)


class CardInput:
    """Continuous sampling, ready or running."""

    def __init__(self, task: nidaqmx.Task, n_channels: int, where: str) -> None:
        self.n_channels = n_channels
        self._task = task
        self._where = where
        self._reader = AnalogMultiChannelReader(task.in_stream)
        # `read` makes the array itself; to check it the reader would ask the card for its channels every time
        self._reader.verify_array_shape = False
        self._scratch: FloatArray = np.empty((n_channels, 0))

    def start(self) -> None:
        """Start sampling."""
        with _as_own_errors(f"{self._where}: starting the inputs"):
            self._task.start()

    def read(self, n: int, timeout_s: float) -> FloatArray:
        """Return the next ``n`` samples, (n_channels, n), V; valid until the next call.

        Raises SamplesLateError after ``timeout_s`` (``samples_done`` says how many had come),
        SamplesLostError where they were overwritten.
        """
        if self._scratch.shape[1] != n:
            # exactly n columns: a short read packs the channels one behind the other, not by row
            self._scratch = np.empty((self.n_channels, n))
        with _as_own_errors(f"{self._where}: reading {n} samples"):
            self._reader.read_many_sample(self._scratch, number_of_samples_per_channel=n, timeout=timeout_s)
        return self._scratch

    def available(self) -> int:
        """Samples that can be read without waiting."""
        with _as_own_errors(f"{self._where}: asking for the samples at hand"):
            return int(self._task.in_stream.avail_samp_per_chan)

    def acquired(self) -> int:
        """Samples taken since the start, read or not."""
        with _as_own_errors(f"{self._where}: asking how many samples were taken"):
            return int(self._task.in_stream.total_samp_per_chan_acquired)

    def close(self) -> None:
        """Stop sampling and free the inputs."""
        with _as_own_errors(f"{self._where}: closing the inputs"):
            self._task.close()


class CardOutput:
    """One finite waveform, loaded or playing."""

    def __init__(self, task: nidaqmx.Task, where: str) -> None:
        self._task = task
        self._where = where

    def start(self) -> None:
        """Start playing, or wait for the trigger."""
        with _as_own_errors(f"{self._where}: starting the output"):
            self._task.start()

    def generated(self) -> int:
        """Samples that have left the card."""
        with _as_own_errors(f"{self._where}: asking how far the output is"):
            return int(self._task.out_stream.total_samp_per_chan_generated)

    def done(self) -> bool:
        """True when the last sample is out; raises what stopped the output before."""
        with _as_own_errors(f"{self._where}: asking whether the output is done"):
            return bool(self._task.is_task_done())

    def close(self) -> None:
        """Stop at once and free the output, which keeps its last voltage."""
        with _as_own_errors(f"{self._where}: closing the output"):
            self._task.close()


class CardStream(CardOutput):
    """A waveform that is written piece by piece while it plays."""

    def __init__(self, task: nidaqmx.Task, where: str) -> None:
        super().__init__(task, where)
        self._writer = AnalogSingleChannelWriter(task.out_stream, auto_start=False)
        self._writer.verify_array_shape = False  # one channel, one row: no need to ask the card

    def write(self, volts: FloatArray) -> None:
        """Add volts (n,) to what is to be played; OutputStarvedError where it had run dry before."""
        with _as_own_errors(f"{self._where}: writing {len(volts)} samples"):
            self._writer.write_many_sample(np.ascontiguousarray(volts), timeout=_WRITE_TIMEOUT_S)


def _refuse_coerced(task: nidaqmx.Task, rate_hz: float, doing: str) -> None:
    actual_hz = float(task.timing.samp_clk_rate)
    if abs(actual_hz - rate_hz) > 1e-6 * rate_hz:
        raise RateCoercedError(
            f"{doing}: asked for {rate_hz:g} samples/s, the card would take {actual_hz:.6g}; set "
            "card.sample_rate_hz in rig.toml to a rate the card has (20 MHz divided by a whole number)"
        )


@contextlib.contextmanager
def _clearing_on_error(task: nidaqmx.Task) -> Iterator[None]:
    """Clear a task that could not be prepared, so that the card is free again."""
    try:
        yield
    except CardError:
        try:
            task.close()
        except NidaqmxError as error:
            _log.warning("clearing a task that could not be prepared: %s", _first_line(str(error)))
        raise
