"""NI's gRPC device server as far as this bench needs it, in front of the simulated card.

Sessions are kept by name and outlive their clients; errors travel as NI's server sends them, in the trailing
metadata `ni-error`, `ni-samps-per-chan-read`, `ni-samps-per-chan-written`.
"""

# ruff: noqa: N802, D102  (the methods are the driver's calls, under the driver's names)

import itertools
import re
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import grpc
import numpy as np
import session_pb2
from nidaqmx._stubs import nidaqmx_pb2, nidaqmx_pb2_grpc

from sim_hardware.card.attributes import (
    CHANNEL_GETTERS,
    DEVICE_PROPERTIES,
    GETTERS,
    SETTERS,
    SYSTEM,
    not_supported,
    samples_to_read,
)
from sim_hardware.card.card import Card
from sim_hardware.card.channels import Direction, check_device, parse_channels
from sim_hardware.card.errors import MESSAGES, CardError, Code
from sim_hardware.card.packing import packed_samples
from sim_hardware.card.plant import FloatArray
from sim_hardware.card.task import CardTask, Timing
from sim_hardware.card.transfer import ShortReadError, read, write
from sim_hardware.settings import TlsSettings

Answer = Callable[[Any, Any, grpc.ServicerContext], Any]

N_CALLS_AT_ONCE = 32
_GROUP_BY_CHANNEL = 0
_INITIALIZE_NEW, _ATTACH = 1, 2
_START, _STOP, _VERIFY, _COMMIT, _RESERVE, _UNRESERVE, _ABORT = range(7)


def _answers(method: Answer) -> Answer:
    """Serve the call unless the host is stalled; turn a CardError into the status NI's server sends."""

    def served(self: "DaqServicer", request: Any, context: grpc.ServicerContext) -> Any:
        self.card.attend()
        try:
            answer = method(self, request, context)
        except CardError as error:
            self.card.attend()
            metadata = [("ni-error", str(error.code))]
            if error.n_read is not None:
                metadata.append(("ni-samps-per-chan-read", str(error.n_read)))
            if error.n_written is not None:
                metadata.append(("ni-samps-per-chan-written", str(error.n_written)))
            context.set_trailing_metadata(tuple(metadata))
            context.abort(grpc.StatusCode.UNKNOWN, str(error))
        self.card.attend()
        return answer

    return served


class DaqServicer(nidaqmx_pb2_grpc.NiDAQmxServicer):  # type: ignore[misc]  # generated, untyped
    """The calls of the driver's client; what is not here the client reports as not supported."""

    def __init__(self, card: Card) -> None:
        self.card = card
        self._unnamed = itertools.count()
        self._creating = threading.Lock()

    def _task(self, request: Any) -> CardTask:
        task = self.card.tasks.get(request.task.name)
        if task is None:
            raise CardError(Code.INVALID_TASK, f"Task Name: {request.task.name}.")
        return task

    # ---- sessions

    @_answers
    def CreateTask(self, request: Any, context: grpc.ServicerContext) -> Any:
        name = request.session_name
        behavior = request.initialization_behavior
        with self._creating:
            exists = bool(name) and name in self.card.tasks
            if exists and behavior == _INITIALIZE_NEW:
                context.abort(grpc.StatusCode.ALREADY_EXISTS, f"Session {name!r} exists already.")
            if not exists and behavior == _ATTACH:
                context.abort(grpc.StatusCode.FAILED_PRECONDITION, f"There is no session {name!r}.")
            if not exists:
                name = name or f"_unnamedTask<{next(self._unnamed):X}>"
                self.card.create(name)
        return nidaqmx_pb2.CreateTaskResponse(
            task=session_pb2.Session(name=name), new_session_initialized=not exists
        )

    @_answers
    def ClearTask(self, request: Any, context: grpc.ServicerContext) -> Any:
        self.card.clear(self._task(request))
        return nidaqmx_pb2.ClearTaskResponse()

    # ---- configuration

    def _add_channels(self, request: Any, direction: Direction) -> None:
        self.card.add_channels(
            self._task(request),
            parse_channels(
                request.physical_channel,
                request.name_to_assign_to_channel,
                direction,
                request.min_val,
                request.max_val,
            ),
        )

    @_answers
    def CreateAIVoltageChan(self, request: Any, context: grpc.ServicerContext) -> Any:
        self._add_channels(request, "ai")
        return nidaqmx_pb2.CreateAIVoltageChanResponse()

    @_answers
    def CreateAOVoltageChan(self, request: Any, context: grpc.ServicerContext) -> Any:
        self._add_channels(request, "ao")
        return nidaqmx_pb2.CreateAOVoltageChanResponse()

    @_answers
    def CfgSampClkTiming(self, request: Any, context: grpc.ServicerContext) -> Any:
        mode = request.sample_mode_raw or request.sample_mode
        self.card.set_timing(
            self._task(request), Timing(request.rate, mode, request.samps_per_chan, request.source)
        )
        return nidaqmx_pb2.CfgSampClkTimingResponse()

    @_answers
    def CfgDigEdgeStartTrig(self, request: Any, context: grpc.ServicerContext) -> Any:
        self.card.set_start_trigger(self._task(request), request.trigger_source)
        return nidaqmx_pb2.CfgDigEdgeStartTrigResponse()

    @_answers
    def DisableStartTrig(self, request: Any, context: grpc.ServicerContext) -> Any:
        self.card.set_start_trigger(self._task(request), "")
        return nidaqmx_pb2.DisableStartTrigResponse()

    @_answers
    def CfgInputBuffer(self, request: Any, context: grpc.ServicerContext) -> Any:
        SETTERS["SetBufferAttributeUInt32"][0x186C](
            self.card, self._task(request), request.num_samps_per_chan
        )
        return nidaqmx_pb2.CfgInputBufferResponse()

    @_answers
    def CfgOutputBuffer(self, request: Any, context: grpc.ServicerContext) -> Any:
        SETTERS["SetBufferAttributeUInt32"][0x186D](
            self.card, self._task(request), request.num_samps_per_chan
        )
        return nidaqmx_pb2.CfgOutputBufferResponse()

    # ---- running

    @_answers
    def StartTask(self, request: Any, context: grpc.ServicerContext) -> Any:
        self.card.start(self._task(request))
        return nidaqmx_pb2.StartTaskResponse()

    @_answers
    def StopTask(self, request: Any, context: grpc.ServicerContext) -> Any:
        self.card.stop(self._task(request))
        return nidaqmx_pb2.StopTaskResponse()

    @_answers
    def TaskControl(self, request: Any, context: grpc.ServicerContext) -> Any:
        task = self._task(request)
        action = request.action_raw or request.action
        if action == _START:
            self.card.start(task)
        elif action == _STOP:
            self.card.stop(task)
        elif action in {_COMMIT, _RESERVE}:
            self.card.reserve(task)
        elif action in {_UNRESERVE, _ABORT}:
            self.card.abort(task)
        elif action != _VERIFY:
            raise CardError(Code.INVALID_VALUE, f"Action: {action}.")
        return nidaqmx_pb2.TaskControlResponse()

    @_answers
    def IsTaskDone(self, request: Any, context: grpc.ServicerContext) -> Any:
        return nidaqmx_pb2.IsTaskDoneResponse(is_task_done=self.card.is_done(self._task(request)))

    @_answers
    def WaitUntilTaskDone(self, request: Any, context: grpc.ServicerContext) -> Any:
        self.card.wait_until_done(self._task(request), request.time_to_wait)
        return nidaqmx_pb2.WaitUntilTaskDoneResponse()

    @_answers
    def ResetDevice(self, request: Any, context: grpc.ServicerContext) -> Any:
        self.card.reset(request.device_name)
        return nidaqmx_pb2.ResetDeviceResponse()

    # ---- samples

    @_answers
    def ReadAnalogF64(self, request: Any, context: grpc.ServicerContext) -> Any:
        task = self._task(request)
        task.need("ai")
        n, size = request.num_samps_per_chan, request.array_size_in_samps
        if n < 0:
            with self.card.at_now():
                n = samples_to_read(self.card, task)
        if n * len(task.channels) > size:
            raise CardError(Code.READ_ARRAY_TOO_SMALL, f"Task Name: {task.name}.", n_read=0)
        status = 0
        try:
            samples = read(self.card, task, n, request.timeout)
        except ShortReadError as short:  # NI's server hands over what came, with the status in the answer
            samples, status = short.partial, short.code
        if request.fill_mode_raw != _GROUP_BY_CHANNEL:
            samples = samples.T
        return packed_samples(samples, size, n_read=samples.size // len(task.channels), status=status)

    @_answers
    def ReadAnalogScalarF64(self, request: Any, context: grpc.ServicerContext) -> Any:
        samples = read(self.card, self._task(request), 1, request.timeout)
        return nidaqmx_pb2.ReadAnalogScalarF64Response(value=samples[0, 0])

    @_answers
    def WriteAnalogF64(self, request: Any, context: grpc.ServicerContext) -> Any:
        task = self._task(request)
        task.need("ao")
        n, n_channels = request.num_samps_per_chan, len(task.channels)
        values = np.fromiter(request.write_array, dtype=np.float64, count=len(request.write_array))
        if n < 1 or n * n_channels != len(values):
            raise CardError(Code.CHANNEL_COUNT_MISMATCH, f"Task Name: {task.name}.", n_written=0)
        by_channel = request.data_layout_raw == _GROUP_BY_CHANNEL
        samples = values.reshape(n_channels, n) if by_channel else values.reshape(n, n_channels).T
        return nidaqmx_pb2.WriteAnalogF64Response(
            samps_per_chan_written=self._write(task, samples, request.auto_start, request.timeout)
        )

    @_answers
    def WriteAnalogScalarF64(self, request: Any, context: grpc.ServicerContext) -> Any:
        task = self._task(request)
        self._write(task, np.array([[request.value]]), request.auto_start, request.timeout)
        return nidaqmx_pb2.WriteAnalogScalarF64Response()

    def _write(self, task: CardTask, samples: FloatArray, auto_start: bool, timeout_s: float) -> int:
        return write(self.card, task, samples, auto_start=auto_start, timeout_s=timeout_s)

    def GetErrorString(self, request: Any, context: grpc.ServicerContext) -> Any:
        return nidaqmx_pb2.GetErrorStringResponse(error_string=MESSAGES.get(request.error_code, ""))


def _respond(name: str, value: Any) -> Any:
    """The answer to a property call; enumerations travel as plain numbers in `value_raw`."""
    response = getattr(nidaqmx_pb2, f"{name}Response")()
    setattr(response, "value_raw" if "value_raw" in response.DESCRIPTOR.fields_by_name else "value", value)
    return response


def _property_call(name: str) -> Answer:
    """The servicer's method for a call that gets or sets properties of tasks, channels, device or system."""

    @_answers
    def call(self: DaqServicer, request: Any, context: grpc.ServicerContext) -> Any:
        attribute = request.attribute_raw or request.attribute
        if name in SYSTEM:
            if attribute not in SYSTEM[name]:
                raise not_supported(attribute)
            return _respond(name, SYSTEM[name][attribute])
        if name in DEVICE_PROPERTIES:
            check_device(request.device_name)
            if not self.card.present:
                raise CardError(Code.NO_SUCH_DEVICE, f"Device Specified: {request.device_name}.")
            if attribute not in DEVICE_PROPERTIES[name]:
                raise not_supported(attribute)
            return _respond(name, DEVICE_PROPERTIES[name][attribute])
        task = self._task(request)
        if name in CHANNEL_GETTERS:
            first = re.split("[,:]", request.channel)[0].strip()  # of a list such as `Dev1/ao0:1`
            channels = [c for c in task.channels if not first or first in {c.name, c.physical}]
            if attribute not in CHANNEL_GETTERS[name] or not channels:
                raise not_supported(attribute)
            return _respond(name, CHANNEL_GETTERS[name][attribute](channels[0]))
        with self.card.at_now():
            if name in GETTERS:
                if attribute not in GETTERS[name]:
                    raise not_supported(attribute)
                return _respond(name, GETTERS[name][attribute](self.card, task))
            if attribute not in SETTERS[name]:
                raise not_supported(attribute)
            value = request.value_raw if "value_raw" in request.DESCRIPTOR.fields_by_name else request.value
            SETTERS[name][attribute](self.card, task, value)
            return getattr(nidaqmx_pb2, f"{name}Response")()

    return call


for _name in (*GETTERS, *SETTERS, *CHANNEL_GETTERS, *SYSTEM, *DEVICE_PROPERTIES):
    setattr(DaqServicer, _name, _property_call(_name))


def serve(card: Card, port: int = 0, tls: TlsSettings | None = None) -> tuple[grpc.Server, int]:
    """Serve the card on the loopback interface, to known clients only with ``tls``; the running server, its port."""
    server = grpc.server(
        ThreadPoolExecutor(max_workers=N_CALLS_AT_ONCE, thread_name_prefix="card call"),
        options=[("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1)],
    )
    nidaqmx_pb2_grpc.add_NiDAQmxServicer_to_server(DaqServicer(card), server)
    where = f"127.0.0.1:{port}"
    if tls is None:
        bound = server.add_insecure_port(where)
    else:
        pair = (Path(tls.key).read_bytes(), Path(tls.certificate).read_bytes())
        credentials = grpc.ssl_server_credentials(
            [pair], root_certificates=Path(tls.authority).read_bytes(), require_client_auth=True
        )
        bound = server.add_secure_port(where, credentials)
    server.start()
    return server, bound
