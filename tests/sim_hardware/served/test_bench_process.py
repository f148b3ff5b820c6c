"""The bench as a process of its own, as the rig starts it and as a person does."""

import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
import xmlrpc.client

import grpc
import nidaqmx
import psutil
import pytest
import serial

from sim_hardware.__main__ import main

COMMAND = [sys.executable, "-m", "sim_hardware"]
SETTINGS = 'seed = 3\ntime = "virtual"\n[[effects]]\nname = "coulomb_friction"\n'


@pytest.fixture
def start(tmp_path):
    started = []

    def go(*arguments):
        process = subprocess.Popen(
            [*COMMAND, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
        )
        started.append(process)
        return process

    yield go
    for process in started:
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout, process.stderr):
            pipe.close()


def addresses_of(process):
    return json.loads(process.stdout.readline())


def test_it_lives_until_its_stdin_closes_whoever_holds_it(start):
    process = start()
    other_holder = os.dup(process.stdin.fileno())
    process.stdin.write("seed = 3\ntime = 'virtual'\n# end\n")
    process.stdin.flush()
    addresses = addresses_of(process)
    assert sorted(addresses) == ["balance", "card", "control", "stage"]
    process.stdin.close()
    process.send_signal(signal.SIGINT)
    time.sleep(0.3)
    assert process.poll() is None, "Ctrl-C and one holder less do not end it"
    with xmlrpc.client.ServerProxy(addresses["control"]) as control:
        assert control.sleep(3.0) == pytest.approx(3.0, abs=0.01)
        assert control.truth()["volts_per_mm"] == pytest.approx(2.042, rel=0.2)
        assert control.request("place_finger", {"finger": "thumb", "site": "a", "repeat": 1})
        assert set(control.arm()) >= {
            "position_mm",
            "tip_mm",
            "force_mn",
            "in_contact",
            "command_v",
            "time_s",
        }
    port = serial.serial_for_url(addresses["stage"], timeout=5)
    port.write(b"/1 home\n")
    assert port.readline() == b"@01 0 OK IDLE -- 0\r\n"
    port.close()
    os.close(other_holder)
    assert process.wait(10) == 0
    assert process.stderr.read() == ""


def test_it_ends_although_a_client_still_waits(start):
    process = start()
    process.stdin.write("# end\n")
    process.stdin.flush()
    channel = grpc.insecure_channel(addresses_of(process)["card"])
    task = nidaqmx.Task(grpc_options=nidaqmx.GrpcSessionOptions(channel, ""))
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    task.timing.cfg_samp_clk_timing(8000.0)
    task.triggers.start_trigger.cfg_dig_edge_start_trig("/Dev1/PFI0")
    task.start()
    ended = []

    def wait_for_ever():
        try:
            task.read(10, timeout=nidaqmx.constants.WAIT_INFINITELY)
        except (nidaqmx.errors.DaqError, nidaqmx.errors.RpcError) as error:
            ended.append(error)

    waiting = threading.Thread(target=wait_for_ever)
    waiting.start()
    time.sleep(0.2)
    process.stdin.close()
    assert process.wait(10) == 0
    waiting.join(10)
    assert len(ended) == 1
    channel.close()


def test_it_listens_on_the_loopback_interface_alone(start):
    process = start()
    process.stdin.write("time = 'virtual'\n# end\n")
    process.stdin.flush()
    addresses_of(process)
    listening = [c for c in psutil.Process(process.pid).net_connections() if c.status == psutil.CONN_LISTEN]
    assert len(listening) == 4
    assert {c.laddr.ip.removeprefix("::ffff:") for c in listening} == {"127.0.0.1"}


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_started_by_hand_it_lives_until_it_is_told_to_end(start, tmp_path, how):
    (tmp_path / "bench.toml").write_text(SETTINGS)
    process = start("--config", "bench.toml")
    process.stdin.close()
    assert addresses_of(process)["card"].startswith("127.0.0.1:")
    process.send_signal(how)
    assert process.wait(10) == 0
    assert process.stderr.read() == ""


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ("seed = 'x'\n# end\n", "seed"),
        ("seed = \n# end\n", "TOML"),
        ("moon = 1\n# end\n", "moon"),
        ("time = 'slow'\n# end\n", "time"),
        ("[[effects]]\nname = 'gravity'\n# end\n", "gravity"),
        ("[[faults]]\nkind = 'flood'\n# end\n", "kind"),
        ("loopback_wired = 'yes'\n# end\n", "loopback_wired"),
        ("seed = 1\n", "# end"),
        ("", "# end"),
        (b"seed = 1 # \xff\n# end\n", "UTF-8"),
    ],
)
def test_malformed_settings_are_one_line_and_exit_2(settings, says, monkeypatch, capsys):
    text = settings if isinstance(settings, bytes) else settings.encode()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text)))
    assert main([]) == 2
    out, message = capsys.readouterr()
    assert out == ""
    assert message.count("\n") == 1
    assert says in message


def test_a_config_that_can_not_be_read(start):
    process = start("--config", "nowhere.toml")
    assert process.wait(10) == 2
    assert process.stderr.read() == "nowhere.toml: can't be read: No such file or directory\n"
