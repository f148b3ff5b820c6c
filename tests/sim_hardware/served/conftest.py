"""A bench served in this process, and the driver's real client to call it with."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import AcquisitionType, RegenerationMode

from sim_hardware.server.services import Services
from sim_hardware.settings import BenchSettings

RATE_HZ = 8000.0


class CountingWorld:
    """A world that repeats its command as position, and counts its samples as force (0.1 mV each)."""

    def __init__(self) -> None:
        self.n = 0
        self.rested_s = 0.0
        self.requests: list[tuple[str, dict[str, Any]]] = []
        self.command_v = np.zeros(0)

    @property
    def time_s(self) -> float:
        return self.n / RATE_HZ + self.rested_s

    def advance(self, command_v: np.ndarray) -> Any:
        self.command_v = command_v

        class Readings:
            position_v = command_v.copy()
            force_v = np.arange(self.n, self.n + len(command_v)) * 1e-4

        self.n += len(command_v)
        return Readings

    def rest(self, duration_s: float) -> None:
        self.rested_s += duration_s

    def request(self, kind: str, details: dict[str, Any]) -> str:
        if kind == "impossible":
            raise ValueError("request 'impossible': can't be done")
        self.requests.append((kind, details))
        return f"{kind} done"

    def arm(self) -> dict[str, Any]:
        return {"command_v": np.float64(self.command_v[-1]), "in_contact": np.bool_(False)}

    def truth(self) -> dict[str, Any]:
        return {"seed": 2**40, "zeros": np.array([1.0, 2.0]), "pair": (1, None)}


class Client:
    """The driver's client, connected to one bench; makes tasks as the rig would."""

    def __init__(self, address: str) -> None:
        self.channel = grpc.insecure_channel(address)
        self.tasks: list[nidaqmx.Task] = []

    def options(self, name: str = "", behavior: int = 0) -> nidaqmx.GrpcSessionOptions:
        return nidaqmx.GrpcSessionOptions(
            self.channel,
            name,
            initialization_behavior=nidaqmx.grpc_session_options.SessionInitializationBehavior(behavior),
        )

    def task(self, name: str = "", behavior: int = 0) -> nidaqmx.Task:
        task = nidaqmx.Task(name, grpc_options=self.options(name, behavior))
        self.tasks.append(task)
        return task

    def input(
        self,
        channels: str = "Dev1/ai0:2",
        *,
        mode: AcquisitionType = AcquisitionType.CONTINUOUS,
        n: int = 80_000,
    ) -> nidaqmx.Task:
        task = self.task()
        task.ai_channels.add_ai_voltage_chan(channels, min_val=-10.0, max_val=10.0)
        task.timing.cfg_samp_clk_timing(RATE_HZ, sample_mode=mode, samps_per_chan=n)
        return task

    def output(
        self,
        volts: np.ndarray | None = None,
        *,
        n: int | None = None,
        mode: AcquisitionType = AcquisitionType.FINITE,
        with_input: bool = False,
        regenerate: bool = False,
    ) -> nidaqmx.Task:
        """An output task, loaded with `volts` but not started; on AI's start trigger where `with_input`."""
        task = self.task()
        task.ao_channels.add_ao_voltage_chan("Dev1/ao0", min_val=-10.0, max_val=10.0)
        length = n if n is not None else 1000 if volts is None else len(volts)
        task.timing.cfg_samp_clk_timing(RATE_HZ, sample_mode=mode, samps_per_chan=length)
        if not regenerate:
            task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
        if with_input:
            task.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/ai/StartTrigger")
        if volts is not None:
            assert task.write(volts, auto_start=False) == len(volts)
        return task

    def close(self) -> None:
        for task in self.tasks:
            if task._handle is not None:
                task.close()
        self.channel.close()


class Bench:
    """A served bench with its world and a client."""

    def __init__(self, settings: dict[str, Any], world: Any) -> None:
        self.world = world
        self.services = Services(BenchSettings(**settings), bench=world)
        self.card = self.services.card
        self.address = self.services.addresses["card"]
        self.client = Client(self.address)

    def close(self) -> None:
        self.client.close()
        self.services.close()


@pytest.fixture
def served() -> Iterator[Callable[..., Bench]]:
    """Serve a bench with a counting world: `served(time="virtual", ...)`."""
    with ExitStack() as stack:

        def start(**settings: Any) -> Bench:
            bench = Bench({"time": "virtual", "initial_command_v": 0.0, **settings}, CountingWorld())
            stack.callback(bench.close)
            return bench

        yield start


@pytest.fixture(params=["virtual", "real"])
def bench(request: pytest.FixtureRequest, served: Callable[..., Bench]) -> Bench:
    """A bench in virtual and in real time, one after the other."""
    return served(time=request.param)


@pytest.fixture
def virtual(served: Callable[..., Bench]) -> Bench:
    """A bench in virtual time."""
    return served()
