"""The card through the driver's real client, call for call."""

import threading
import time

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import AcquisitionType, RegenerationMode, TaskMode
from nidaqmx.errors import DaqError, DaqReadError, DaqWriteError, RpcError
from nidaqmx.stream_readers import AnalogMultiChannelReader
from nidaqmx.stream_writers import AnalogSingleChannelWriter

LSB_V = 20 / 65536
AUTO, NEW, ATTACH = 0, 1, 2


def code_of(call, *arguments, **keywords):
    with pytest.raises(DaqError) as caught:
        call(*arguments, **keywords)
    return caught.value.error_code


def counts(force_v):
    """Sample numbers from the counting world's force line."""
    return np.rint(np.asarray(force_v) / 1e-4).astype(int)


def read(task, n, timeout_s=5.0):
    data = np.empty((task.in_stream.num_chans, n))
    AnalogMultiChannelReader(task.in_stream).read_many_sample(data, n, timeout=timeout_s)
    return data


# ---- sessions


def test_a_task_has_its_sessions_name(virtual):
    task = virtual.client.task("approach")
    assert task.name == "approach"
    assert virtual.client.task().name != virtual.client.task().name


def test_a_session_outlives_its_client_and_is_attached_to_by_name(virtual):
    virtual.client.input()
    named = virtual.client.task("left over")
    named.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    channel = grpc.insecure_channel(virtual.address)
    second = nidaqmx.Task(
        "left over",
        grpc_options=nidaqmx.GrpcSessionOptions(
            channel,
            "left over",
            initialization_behavior=nidaqmx.grpc_session_options.SessionInitializationBehavior(ATTACH),
        ),
    )
    assert second.channel_names == ["Dev1/ai0"]
    second.close()
    channel.close()
    assert code_of(lambda: named.channel_names) == -200088
    named._handle = None


def test_sessions_are_new_or_attached_as_asked(virtual):
    virtual.client.task("one", NEW)
    with pytest.raises(RpcError) as refused:
        virtual.client.task("one", NEW)
    assert refused.value.rpc_code == grpc.StatusCode.ALREADY_EXISTS
    with pytest.raises(RpcError) as missing:
        virtual.client.task("two", ATTACH)
    assert missing.value.rpc_code == grpc.StatusCode.FAILED_PRECONDITION
    virtual.client.tasks[0].close()
    virtual.client.task("one", NEW)


def test_what_the_card_is(virtual):
    system = nidaqmx.system.System.remote(virtual.client.options())
    device = system.devices["Dev1"]
    assert device.product_type == "PCI-6120"
    assert device.is_simulated
    assert [c.name for c in device.ai_physical_chans] == [f"Dev1/ai{i}" for i in range(4)]
    assert [c.name for c in device.ao_physical_chans] == ["Dev1/ao0", "Dev1/ao1"]


# ---- configuration


def test_the_rate_is_read_back(virtual):
    task = virtual.client.input()
    assert task.timing.samp_clk_rate == 8000.0
    task.timing.samp_clk_rate = 7999.0
    assert task.timing.samp_clk_rate == 8000.0
    assert task.timing.samp_quant_samp_mode is AcquisitionType.CONTINUOUS
    assert task.timing.samp_quant_samp_per_chan == 80_000


def test_a_coerced_rate_shows(virtual):
    virtual.card.coerced_rate_hz = 8012.82
    assert virtual.client.input().timing.samp_clk_rate == 8012.82


def test_buffers_are_sized_by_hand_or_by_rule(virtual):
    task = virtual.client.input(n=500)
    assert task.in_stream.input_buf_size == 10_000
    task.in_stream.input_buf_size = 240_000
    assert task.in_stream.input_buf_size == 240_000
    output = virtual.client.output()
    assert output.out_stream.output_buf_size == 0
    output.out_stream.output_buf_size = 4000
    assert output.out_stream.output_buf_size == 4000
    assert output.out_stream.space_avail == 4000
    assert output.out_stream.regen_mode is RegenerationMode.DONT_ALLOW_REGENERATION


@pytest.mark.parametrize(
    ("channel", "code"),
    [("Dev2/ai0", -200220), ("Dev1/ai7", -200170), ("Dev1/ao0", -200170), ("Dev1/line0", -200170)],
)
def test_channels_that_do_not_exist(virtual, channel, code):
    assert code_of(virtual.client.task().ai_channels.add_ai_voltage_chan, channel) == code


def test_refusals_of_configuration(virtual):
    task = virtual.client.input()
    assert code_of(task.ai_channels.add_ai_voltage_chan, "Dev1/ai0") == -200489
    assert code_of(task.ao_channels.add_ao_voltage_chan, "Dev1/ao0") == -200559
    assert code_of(task.ai_channels.add_ai_voltage_chan, "Dev1/ai3", min_val=-42, max_val=42) == -200077
    assert code_of(task.triggers.start_trigger.cfg_dig_edge_start_trig, "/Dev1/moon") == -89120
    single_point = AcquisitionType.HW_TIMED_SINGLE_POINT
    assert code_of(task.timing.cfg_samp_clk_timing, 8000, sample_mode=single_point) == -200077
    task.start()
    assert code_of(task.timing.cfg_samp_clk_timing, 8000) == -200479
    assert code_of(virtual.client.task().start) == -200478


def test_properties_the_card_does_not_have(virtual):
    task = virtual.client.input()
    assert code_of(lambda: task.timing.ai_conv_rate) == -200452
    assert code_of(lambda: task.in_stream.logging_file_path) == -200452
    with pytest.raises(RpcError) as unknown:
        task.export_signals.export_signal(nidaqmx.constants.Signal.SAMPLE_CLOCK, "/Dev1/PFI0")
    assert unknown.value.rpc_code == grpc.StatusCode.UNIMPLEMENTED


# ---- synchronous input and output


@pytest.mark.parametrize("late", [0, 1, 37])
def test_output_and_input_start_together_to_the_sample(bench, late):
    bench.card.late_start_samples = late
    ramp = np.linspace(-5.0, 5.0, 400)
    output, task = bench.client.output(ramp, with_input=True), bench.client.input("Dev1/ai2, Dev1/ai0:1")
    output.start()
    assert not output.is_task_done()
    task.start()
    loopback, position, force = read(task, 500)
    expected = np.concatenate([np.zeros(late), ramp, np.full(500, ramp[-1])])[:500]
    assert np.max(np.abs(loopback - expected)) <= LSB_V / 2
    assert np.array_equal(loopback, position)
    assert np.array_equal(np.diff(counts(force)), np.ones(499))
    output.wait_until_done(1.0)
    assert output.out_stream.total_samp_per_chan_generated == 400


def test_a_later_output_begins_with_the_next_sample(virtual):
    virtual.card.late_start_samples = 3
    task = virtual.client.input("Dev1/ai2")
    task.start()
    read(task, 100)
    output = virtual.client.output(np.array([1.0, 2.0, 3.0]))
    output.start()
    loopback = read(task, 10)[0]
    assert np.allclose(loopback, [0, 0, 0, 1, 2, 3, 3, 3, 3, 3], atol=LSB_V)


def test_a_trigger_that_has_passed_does_not_come_again(virtual):
    task = virtual.client.input("Dev1/ai2")
    task.start()
    output = virtual.client.output(np.ones(5), with_input=True)
    output.start()
    assert not np.any(read(task, 50))
    assert code_of(output.wait_until_done, 0.01) == -200560
    task.stop()
    task.start()
    assert np.allclose(read(task, 5), 1.0, atol=LSB_V)


def test_an_output_on_the_inputs_clock_moves_only_while_the_input_runs(virtual):
    output = virtual.client.output(np.array([1.0, 2.0, 3.0, 4.0]))
    output.timing.samp_clk_src = "/Dev1/ai/SampleClock"
    output.start()
    virtual.card.sleep(1.0)
    assert output.out_stream.total_samp_per_chan_generated == 0
    task = virtual.client.input("Dev1/ai2", mode=AcquisitionType.FINITE, n=2)
    assert np.allclose(read(task, 2), [[1, 2]], atol=LSB_V)
    virtual.card.sleep(1.0)
    assert output.out_stream.total_samp_per_chan_generated == 2


def test_an_open_loopback_reads_noise(served):
    bench = served(loopback_wired=False)
    output, task = bench.client.output(np.full(300, 5.0), with_input=True), bench.client.input("Dev1/ai2:3")
    output.start()
    task.start()
    data = read(task, 300)
    assert np.max(np.abs(data)) < 0.01
    assert np.std(data) > 0


def test_readings_are_sixteen_bit(virtual):
    output, task = virtual.client.output(np.linspace(-10, 10, 1000)), virtual.client.input("Dev1/ai2")
    output.start()
    task.start()
    codes = read(task, 1000) / LSB_V
    assert np.array_equal(codes, np.rint(codes))
    assert codes.min() == -32768
    assert codes.max() == 32767


# ---- buffers run over, run dry, come late


def test_unread_samples_overwritten(bench):
    task = bench.client.input()
    task.in_stream.input_buf_size = 4000
    task.start()
    read(task, 50)
    bench.card.sleep(0.7)
    for _ in range(2):
        with pytest.raises(DaqReadError) as lost:
            read(task, 50)
        assert lost.value.error_code == -200279
    task.stop()
    task.start()
    read(task, 50)


def test_samples_that_come_too_late_are_counted_and_packed(bench):
    task = bench.client.input("Dev1/ai0:1", mode=AcquisitionType.CONTINUOUS)
    task.start()
    data = np.full((2, 16_000), np.nan)
    with pytest.raises(DaqReadError) as late:
        AnalogMultiChannelReader(task.in_stream).read_many_sample(data, 16_000, timeout=0.05)
    assert late.value.error_code == -200284
    n = late.value.samps_per_chan_read
    assert 400 <= n < 16_000
    packed = data.ravel()
    first = counts(packed[n : 2 * n])
    assert np.array_equal(first, np.arange(first[0], first[0] + n))
    following = counts(read(task, 10)[1])
    assert following[0] == first[-1] + 1, "what a short read handed over is not read again"


def test_no_timeout_tries_once(virtual):
    task = virtual.client.input()
    task.start()
    with pytest.raises(DaqReadError) as late:
        read(task, 10, timeout_s=0.0)
    assert (late.value.error_code, late.value.samps_per_chan_read) == (-200284, 0)


def test_output_starves(bench):
    output = bench.client.output(np.linspace(0, 2, 80), mode=AcquisitionType.CONTINUOUS)
    task = bench.client.input("Dev1/ai2")
    output.start()
    task.start()
    loopback = read(task, 200)[0]
    assert loopback[-1] == pytest.approx(2.0, abs=LSB_V)
    assert code_of(output.is_task_done) == -200290
    assert code_of(output.wait_until_done, 0.1) == -200290
    assert code_of(output.write, np.zeros(10)) == -200290
    output.stop()
    assert read(task, 100)[0, -1] == pytest.approx(2.0, abs=LSB_V)


def test_a_stop_reports_a_starved_output_once(virtual):
    output = virtual.client.output(np.ones(10), mode=AcquisitionType.CONTINUOUS)
    output.start()
    virtual.card.sleep(0.1)
    assert code_of(output.stop) == -200290
    output.stop()


def test_an_output_fed_in_time_does_not_starve(virtual):
    output = virtual.client.output(mode=AcquisitionType.CONTINUOUS)
    output.out_stream.output_buf_size = 400
    wave = np.linspace(-1, 1, 2000)
    task = virtual.client.input("Dev1/ai2")
    assert output.write(wave[:400], auto_start=False) == 400
    output.start()
    task.start()
    for start in range(400, 2000, 100):
        assert output.write(wave[start : start + 100], timeout=1.0) == 100
    assert np.max(np.abs(read(task, 1990)[0] - wave[:1990])) <= LSB_V / 2


def test_a_write_without_room(virtual):
    output = virtual.client.output(np.zeros(100))
    with pytest.raises(DaqWriteError) as full:
        output.write(np.zeros(10), auto_start=False, timeout=0.1)
    assert (full.value.error_code, full.value.samps_per_chan_written) == (-200292, 0)
    sized = virtual.client.task()
    sized.ao_channels.add_ao_voltage_chan("Dev1/ao1")
    sized.timing.cfg_samp_clk_timing(8000, samps_per_chan=100)
    output.close()
    sized.out_stream.output_buf_size = 60
    with pytest.raises(DaqWriteError) as partly:
        sized.write(np.zeros(100), auto_start=False, timeout=0.0)
    assert partly.value.samps_per_chan_written == 60


def test_regeneration_plays_round_and_round(virtual):
    output = virtual.client.output(np.arange(4.0), mode=AcquisitionType.CONTINUOUS, regenerate=True)
    task = virtual.client.input("Dev1/ai2")
    output.start()
    task.start()
    assert np.allclose(read(task, 12), np.tile(np.arange(4.0), 3), atol=LSB_V)
    assert output.out_stream.total_samp_per_chan_generated == 12


def test_nothing_is_played_twice_after_a_stop(virtual):
    output = virtual.client.output(np.ones(10))
    output.start()
    output.wait_until_done()
    output.stop()
    assert code_of(output.start) == -200462


def test_volts_outside_the_range_are_refused(virtual):
    output = virtual.client.output()
    for bad in (10.5, -11.0, np.nan):
        with pytest.raises(DaqWriteError) as refused:
            output.write(np.array([0.0, bad]), auto_start=False)
        assert (refused.value.error_code, refused.value.samps_per_chan_written) == (-200561, 0)


def test_finite_input_ends(bench):
    task = bench.client.input("Dev1/ai1", mode=AcquisitionType.FINITE, n=100)
    data = task.read(nidaqmx.constants.READ_ALL_AVAILABLE, timeout=2.0)
    assert len(data) == 100
    assert task.is_task_done()
    assert code_of(task.read, 1, 0.1) == -200278


def test_read_all_available_of_a_continuous_input(virtual):
    task = virtual.client.input("Dev1/ai1")
    task.start()
    virtual.card.sleep(0.01)
    assert task.in_stream.avail_samp_per_chan == 80
    assert len(task.read(nidaqmx.constants.READ_ALL_AVAILABLE)) == 80
    assert task.in_stream.total_samp_per_chan_acquired == 80


def test_a_read_larger_than_the_buffer(virtual):
    task = virtual.client.input("Dev1/ai1")
    task.in_stream.input_buf_size = 100
    task.start()
    numbers = counts(read(task, 1000)[0])
    assert np.array_equal(np.diff(numbers), np.ones(999))


def test_reading_an_output_and_writing_an_input(virtual):
    output, task = virtual.client.output(), virtual.client.input()
    assert code_of(output._interpreter.read_analog_f64, output._handle, 1, 0.0, 0, np.zeros(1)) == -200460
    assert code_of(task._interpreter.write_analog_f64, task._handle, 1, False, 0.0, 0, np.zeros(1)) == -200459
    assert code_of(output.start) == -200462


# ---- who holds the card


def test_a_resource_is_held_by_one_task(virtual):
    first, second = virtual.client.input(), virtual.client.input()
    first.start()
    assert code_of(second.start) == -50103
    assert code_of(second.control, TaskMode.TASK_RESERVE) == -50103
    first.stop()
    second.start()


def test_a_loaded_output_holds_its_channel_until_it_is_cleared(virtual):
    loaded = virtual.client.output(np.zeros(10))
    other = virtual.client.output()
    assert code_of(other.write, np.zeros(10), auto_start=False) == -50103
    on_demand = virtual.client.task()
    on_demand.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    assert code_of(on_demand.write, 1.0) == -50103
    loaded.close()
    on_demand.write(1.0)


def test_a_read_in_another_thread_ends_with_the_task(served):
    bench = served(time="real")
    task = bench.client.input()
    task.start()
    caught = []

    def wait_long():
        try:
            read(task, 80_000, timeout_s=20.0)
        except DaqError as error:
            caught.append(error.error_code)

    reader = threading.Thread(target=wait_long)
    reader.start()
    time.sleep(0.1)
    task.stop()
    reader.join(2.0)
    assert caught == [-88710]


# ---- outputs keep their value


def test_the_output_keeps_its_last_value(bench):
    def now_v():
        probe = bench.client.task()
        probe.ai_channels.add_ai_voltage_chan("Dev1/ai2")
        value = probe.read()
        probe.close()
        return pytest.approx(value, abs=LSB_V)

    output = bench.client.output(np.linspace(0, 4, 16_000))
    output.start()
    bench.card.sleep(0.25)
    output.stop()
    stopped_at = bench.card.output_v[0]
    assert 0.45 < stopped_at < 3.9
    assert stopped_at == now_v()
    output.close()
    assert stopped_at == now_v()
    nidaqmx.system.System.remote(bench.client.options()).devices["Dev1"].reset_device()
    assert stopped_at == now_v()


def test_reset_aborts_the_tasks(virtual):
    output, task = virtual.client.output(np.ones(100)), virtual.client.input()
    output.start()
    task.start()
    nidaqmx.system.System.remote(virtual.client.options()).devices["Dev1"].reset_device()
    assert virtual.card.tasks[task.name].state.value == "configured"
    again = virtual.client.input()
    again.start()
    device = nidaqmx.system.device.Device("Dev9", grpc_options=virtual.client.options())
    assert code_of(device.reset_device) == -200220


# ---- software timing


def test_a_guard_reads_and_writes_without_a_clock(bench):
    left_over, acquiring = bench.client.output(np.linspace(0, 5, 8000)), bench.client.input()
    left_over.start()
    acquiring.start()
    bench.card.sleep(0.1)
    left_over.close()
    acquiring.close()
    position = bench.client.task()
    position.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    command = bench.client.task()
    command.ao_channels.add_ao_voltage_chan("Dev1/ao0", min_val=-10, max_val=10)
    volts = position.read()
    assert volts == pytest.approx(bench.card.output_v[0], abs=LSB_V)
    writer = AnalogSingleChannelWriter(command.out_stream)
    while volts > -1.0:
        volts -= 0.05
        writer.write_one_sample(volts)
    assert position.read() == pytest.approx(volts, abs=LSB_V)
    assert len(position.read(3)) == 3
    assert code_of(lambda: position.timing.samp_clk_rate) == -200452


def test_scalars_and_both_orders_of_samples(virtual):
    two = virtual.client.task()
    two.ao_channels.add_ao_voltage_chan("Dev1/ao0:1", min_val=-10, max_val=10)
    two.write([1.0, -2.0])
    assert np.allclose(virtual.card.output_v, [1.0, -2.0], atol=LSB_V)
    by_scan = two._interpreter.write_analog_f64(two._handle, 2, True, 1.0, 1, np.array([3.0, 4.0, 5.0, 6.0]))
    assert by_scan == 2
    assert np.allclose(virtual.card.output_v, [5.0, 6.0], atol=LSB_V)
    two.close()
    one = virtual.client.task()
    one.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    AnalogSingleChannelWriter(one.out_stream).write_one_sample(2.0)
    probe = virtual.client.task()
    probe.ai_channels.add_ai_voltage_chan("Dev1/ai0, Dev1/ai3")
    data = np.zeros((3, 2))
    probe._interpreter.read_analog_f64(probe._handle, 3, 1.0, 1, data)
    assert np.allclose(data, [[2.0, 0.0]] * 3, atol=0.01)
    assert probe._interpreter.read_analog_scalar_f64(probe._handle, 1.0) == pytest.approx(2.0, abs=LSB_V)


def test_a_clocked_output_of_two_channels(virtual):
    task = virtual.client.task()
    task.ao_channels.add_ao_voltage_chan("Dev1/ao0:1", min_val=-10, max_val=10)
    task.timing.cfg_samp_clk_timing(8000, samps_per_chan=3)
    task.write(np.array([[1.0, 2.0, 3.0], [-1.0, -2.0, -3.0]]), auto_start=False)
    listening = virtual.client.input("Dev1/ai2")
    listening.start()
    task.start()
    assert np.allclose(read(listening, 4), [[1, 2, 3, 3]], atol=LSB_V)
    assert np.allclose(virtual.card.output_v, [3, -3], atol=LSB_V)


def test_an_input_can_wait_for_the_output(virtual):
    task = virtual.client.input("Dev1/ai2")
    task.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/ao/StartTrigger")
    task.start()
    virtual.card.sleep(0.5)
    assert task.in_stream.total_samp_per_chan_acquired == 0
    with pytest.raises(DaqReadError) as waiting:
        read(task, 10, timeout_s=0.1)
    assert (waiting.value.error_code, waiting.value.samps_per_chan_read) == (-200284, 0)
    virtual.client.output(np.array([1.0, 2.0])).start()
    assert np.allclose(read(task, 3), [[1, 2, 2]], atol=LSB_V)


def test_task_control_moves_a_task_through_its_states(virtual):
    task, other = virtual.client.input(), virtual.client.input()
    task.control(TaskMode.TASK_VERIFY)
    task.control(TaskMode.TASK_COMMIT)
    assert code_of(other.start) == -50103
    task.control(TaskMode.TASK_START)
    assert code_of(task.start) == -200479
    task.control(TaskMode.TASK_STOP)
    assert code_of(other.start) == -50103, "a committed task keeps its resources over a stop"
    task.control(TaskMode.TASK_UNRESERVE)
    other.start()
    other.control(TaskMode.TASK_ABORT)
    task.start()


def test_errors_read_as_the_drivers(virtual):
    task = virtual.client.input()
    task.start()
    with pytest.raises(DaqError) as refused:
        task.start()
    first, *_, last = str(refused.value).splitlines()
    assert first == "Specified operation cannot be performed while the task is running."
    assert last == "Status Code: -200479"
    assert task._interpreter.get_error_string(-200279).startswith("The application is not able to keep up")
