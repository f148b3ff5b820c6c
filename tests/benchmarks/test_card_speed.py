"""How soon the simulated card answers in real time, and how fast it runs in virtual time, through gRPC.

Run with `pytest -m benchmark -s tests/benchmarks/test_card_speed.py`.
"""

import json
import subprocess
import sys
import time
import xmlrpc.client
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import grpc
import nidaqmx
import numpy as np
import psutil
import pytest
from nidaqmx.constants import AcquisitionType, RegenerationMode
from nidaqmx.stream_readers import AnalogMultiChannelReader
from nidaqmx.stream_writers import AnalogSingleChannelWriter

pytestmark = pytest.mark.benchmark

RATE_HZ = 8000.0


@contextmanager
def bench(settings: str) -> Iterator[tuple[dict[str, str], psutil.Process]]:
    """A bench in its own process: its addresses and the process."""
    with subprocess.Popen(
        [sys.executable, "-m", "sim_hardware"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(f"{settings}\n# end\n")
        process.stdin.flush()
        yield json.loads(process.stdout.readline()), psutil.Process(process.pid)
        process.stdin.close()


@contextmanager
def busy(n: int) -> Iterator[None]:
    """Keep n processors busy with other work."""
    hogs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(n)]
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def options(channel: grpc.Channel) -> nidaqmx.GrpcSessionOptions:
    return nidaqmx.GrpcSessionOptions(channel, "")


def inputs(channel: grpc.Channel) -> tuple[nidaqmx.Task, AnalogMultiChannelReader]:
    task = nidaqmx.Task(grpc_options=options(channel))
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0:2", min_val=-10.0, max_val=10.0)
    task.timing.cfg_samp_clk_timing(RATE_HZ, sample_mode=AcquisitionType.CONTINUOUS)
    task.in_stream.input_buf_size = 160_000
    reader = AnalogMultiChannelReader(task.in_stream)
    reader.verify_array_shape = False
    return task, reader


def output(channel: grpc.Channel, volts: np.ndarray[Any, Any]) -> nidaqmx.Task:
    task = nidaqmx.Task(grpc_options=options(channel))
    task.ao_channels.add_ao_voltage_chan("Dev1/ao0", min_val=-10.0, max_val=10.0)
    task.timing.cfg_samp_clk_timing(RATE_HZ, sample_mode=AcquisitionType.FINITE, samps_per_chan=len(volts))
    task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
    task.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/ai/StartTrigger")
    AnalogSingleChannelWriter(task.out_stream).write_many_sample(volts)
    return task


@pytest.mark.parametrize("n_busy", [0, psutil.cpu_count() or 2])
def test_real_time_reads(n_busy: int) -> None:
    n, n_reads = 40, 2000
    with bench('time = "real"') as (addresses, server), busy(n_busy):
        channel = grpc.insecure_channel(addresses["card"])
        task, reader = inputs(channel)
        data = np.empty((3, n))
        task.start()
        reader.read_many_sample(data, n)
        load = server.cpu_times()
        began = time.perf_counter()
        ends = np.empty(n_reads)
        for i in range(n_reads):
            reader.read_many_sample(data, n)
            ends[i] = time.perf_counter()
        load_after = server.cpu_times()
        task.close()
        channel.close()
    periods_ms = np.diff(ends) * 1e3
    late_ms = (ends - began - (1 + np.arange(n_reads)) * n / RATE_HZ) * 1e3
    late_ms -= late_ms.min()
    used_s = load_after.user + load_after.system - load.user - load.system
    print(
        f"\nreal time, {n_busy} processors busy: {n_reads} reads of {n} samples x 3 channels: "
        f"period mean {periods_ms.mean():.3f} ms (ideal 5.000), 99 % {np.percentile(periods_ms, 99):.2f} ms, "
        f"longest {periods_ms.max():.2f} ms; later than the promptest read: median "
        f"{np.median(late_ms):.2f} ms, 99 % {np.percentile(late_ms, 99):.2f} ms, "
        f"longest {late_ms.max():.2f} ms; "
        f"server's load {100 * used_s / (ends[-1] - began):.1f} % of one processor"
    )
    assert periods_ms.mean() == pytest.approx(5.0, rel=0.02)


def test_the_published_study_in_virtual_time() -> None:
    n_trials, trial_s, chunk = 86, 12.0, 800
    n = round(trial_s * RATE_HZ)
    wave = np.concatenate([np.linspace(-9.5, -5.0, n // 2), np.linspace(-5.0, -9.5, n - n // 2)])
    client = psutil.Process()
    with bench('time = "virtual"') as (addresses, server):
        channel = grpc.insecure_channel(addresses["card"])
        data = np.empty((3, chunk))
        before = [p.cpu_times() for p in (client, server)]
        began = time.perf_counter()
        with xmlrpc.client.ServerProxy(addresses["control"]) as control:
            for trial in range(n_trials):
                task, reader = inputs(channel)
                played = output(channel, wave)
                played.start()
                task.start()
                for _ in range(n // chunk):
                    reader.read_many_sample(data, chunk)
                played.close()
                task.close()
                control.sleep(120.0 + 60.0 * trial / n_trials)
            bench_s = float(control.time_s())  # type: ignore[arg-type]
        took_s = time.perf_counter() - began
        after = [p.cpu_times() for p in (client, server)]
        channel.close()
    used_s = [b.user + b.system - a.user - a.system for a, b in zip(before, after, strict=True)]
    print(
        f"\nvirtual time: {n_trials} trials, {n_trials * n / 1e6:.2f} million samples x 3 channels in "
        f"{took_s:.1f} s ({n_trials * n / took_s / 1e3:.0f} thousand samples/s; client {used_s[0]:.1f} s, "
        f"server {used_s[1]:.1f} s of processor time); {bench_s / 3600:.2f} hours of bench time, "
        f"{bench_s / took_s:.0f} times real time, {n_trials * trial_s / took_s:.0f} times without the rests"
    )
    assert took_s < 45.0
