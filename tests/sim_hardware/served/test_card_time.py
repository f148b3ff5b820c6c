"""Real and virtual time, and the faults that can be ordered, through the driver's real client."""

import threading
import time

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import AcquisitionType
from nidaqmx.errors import DaqError, DaqReadError
from nidaqmx.stream_readers import AnalogMultiChannelReader


def code_of(call, *arguments, **keywords):
    with pytest.raises(DaqError) as caught:
        call(*arguments, **keywords)
    return caught.value.error_code


def read(task, n, timeout_s=5.0):
    data = np.empty((task.in_stream.num_chans, n))
    AnalogMultiChannelReader(task.in_stream).read_many_sample(data, n, timeout=timeout_s)
    return data


# ---- virtual time


def test_virtual_time_passes_only_as_far_as_a_call_waits(virtual):
    world = virtual.world
    output, task = virtual.client.output(np.ones(400)), virtual.client.input()
    at_start = world.n
    output.start()
    task.start()
    assert not output.is_task_done()
    assert world.n == at_start
    read(task, 100)
    read(task, 50)
    assert world.n == at_start + 150
    output.wait_until_done()
    assert world.n == at_start + 400
    assert output.is_task_done()
    read(task, 250)
    assert world.n == at_start + 400


def test_a_jump_rests_when_nothing_runs_and_samples_go_by_when_something_does(virtual):
    world = virtual.world
    before = world.n
    virtual.card.sleep(150.0)
    assert (world.rested_s, world.n) == (150.0, before)
    task = virtual.client.input("Dev1/ai1")
    task.start()
    virtual.card.sleep(1.0)
    assert (world.rested_s, world.n) == (150.0, before + 8000)
    assert len(set(read(task, 8000)[0])) == 8000


def test_endless_waits_end_where_virtual_time_can_bring_nothing(virtual):
    triggered = virtual.client.output(np.ones(4), with_input=True)
    triggered.start()
    assert code_of(triggered.wait_until_done, nidaqmx.constants.WAIT_INFINITELY) == -200560


# ---- real time


def test_real_time_runs_at_8000_hz_also_while_nobody_asks(served):
    bench = served(time="real")
    before, began = bench.world.n, time.monotonic()
    time.sleep(0.5)
    n, took = bench.world.n - before, time.monotonic() - began
    assert 0.5 * 8000 * took < n < 8000 * (took + 0.1)


def test_a_real_read_returns_when_its_samples_are_there(served):
    bench = served(time="real")
    task = bench.client.input()
    task.start()
    began = time.monotonic()
    for _ in range(20):
        read(task, 80)
    assert 0.19 < time.monotonic() - began < 3.0


def test_world_and_host_clock_do_not_drift_apart(served):
    bench = served(time="real")
    earliest, latest = [], []
    for _ in range(5):
        time.sleep(0.05)
        before = time.monotonic()
        now_s = bench.card.now_s()
        earliest.append(now_s - time.monotonic())
        latest.append(now_s - before)
    assert max(earliest) <= min(latest) + 2 / 8000


# ---- faults


def test_unplugged_in_mid_trial(bench):
    output, task = bench.client.output(np.linspace(0, 5, 80_000)), bench.client.input()
    output.start()
    task.start()
    read(task, 100)
    bench.card.unplug()
    held = bench.card.output_v[0]
    assert code_of(read, task, 100) == -201003
    assert code_of(output.is_task_done) == -201003
    assert code_of(output.wait_until_done, 0.1) == -201003
    output.stop()
    assert code_of(bench.client.task().ai_channels.add_ai_voltage_chan, "Dev1/ai0") == -200220
    assert code_of(output.start) == -201003
    output.close()
    task.close()
    bench.card.sleep(0.02)
    assert bench.card.output_v[0] == held
    bench.card.replug()
    again = bench.client.input()
    again.start()
    read(again, 10)


def test_unplugging_ends_a_read_that_waits(served):
    bench = served(time="real")
    task = bench.client.input()
    task.start()
    threading.Timer(0.1, bench.card.unplug).start()
    began = time.monotonic()
    assert code_of(read, task, 40_000, 10.0) == -201003
    assert time.monotonic() - began < 2.0


def test_a_stalled_host_loses_samples(bench):
    task = bench.client.input()
    task.in_stream.input_buf_size = 800
    task.start()
    read(task, 10)
    began = time.monotonic()
    bench.card.stall(0.4)
    with pytest.raises(DaqReadError) as lost:
        read(task, 10)
    assert lost.value.error_code == -200279
    if not bench.card.clock.virtual:
        assert time.monotonic() - began >= 0.4


def test_a_stalled_host_starves_the_output_and_replays_nothing(bench):
    output = bench.client.output(np.linspace(0, 1, 1600), mode=AcquisitionType.CONTINUOUS)
    output.start()
    bench.card.stall(0.4)
    assert code_of(output.write, np.zeros(100)) == -200290
    assert bench.card.output_v[0] == pytest.approx(1.0, abs=1e-3)


def test_faults_come_at_their_time(served):
    bench = served(
        faults=[
            {"kind": "late_start", "samples": 5},
            {"kind": "coerce_rate", "rate_hz": 7900.0, "at_s": 0.05},
            {"kind": "unplug", "at_s": 0.1},
        ]
    )
    assert bench.card.late_start_samples == 5
    task = bench.client.input("Dev1/ai1")
    task.start()
    assert bench.client.input().timing.samp_clk_rate == 8000.0
    with pytest.raises(DaqError) as gone:
        read(task, 8000)
    assert gone.value.error_code == -201003
    assert bench.world.n == 800, "the card goes between two samples"
    assert bench.card.coerced_rate_hz == 7900.0


def test_a_dead_clients_tasks_run_on(served):
    bench = served(time="real")
    output, task = bench.client.output(np.linspace(0, 1, 4000), with_input=True), bench.client.input()
    output.start()
    task.start()
    bench.client.channel.close()
    bench.client.tasks.clear()
    time.sleep(0.8)
    assert bench.card.output_v[0] == pytest.approx(1.0, abs=1e-3)
    channel = grpc.insecure_channel(bench.address)
    for name in list(bench.card.tasks):
        nidaqmx.Task(name, grpc_options=nidaqmx.GrpcSessionOptions(channel, name)).close()
    assert not bench.card.tasks
    channel.close()
