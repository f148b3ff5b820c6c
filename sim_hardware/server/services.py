"""All that the bench offers, put together from its settings: card, stage, balance, control."""

import gc
import sys
from concurrent.futures import ThreadPoolExecutor

from sim_hardware.card import Card
from sim_hardware.instruments.balance import Balance
from sim_hardware.instruments.line_server import LineServer
from sim_hardware.instruments.stage import Stage
from sim_hardware.server.control import Bench, Control, ControlServer, order_fault
from sim_hardware.server.daq_server import serve
from sim_hardware.server.latency import ask_for_short_slices
from sim_hardware.settings import BenchSettings
from sim_hardware.world import World
from sim_hardware.world.converters import Converter

SWITCH_INTERVAL_S = 0.0005


class Services:
    """A running bench; `addresses` says where each part listens."""

    def __init__(self, settings: BenchSettings, bench: Bench | None = None) -> None:
        ask_for_short_slices()
        sys.setswitchinterval(SWITCH_INTERVAL_S)  # a call that is due should not wait 5 ms for another thread
        bench = World(settings) if bench is None else bench
        self.card = Card(
            bench,
            virtual=settings.time == "virtual",
            loopback_wired=settings.loopback_wired,
            late_start_samples=settings.late_start_samples,
            initial_command_v=settings.initial_command_v,
            converter=Converter(settings.converters),
            seed=settings.seed,
        )
        for fault in settings.faults:
            happen = order_fault(self.card, fault.kind, fault.model_dump())
            if fault.at_s > 0:
                self.card.at_time(fault.at_s, happen)
            else:
                happen()
        balance = Balance(self.card.now_s, self.card.sleep, seed=settings.seed)
        stage = Stage(self.card.now_s, lambda um: self._move_block(bench, um))
        self._lines = {"stage": LineServer(stage), "balance": LineServer(balance)}
        self._control = ControlServer(Control(self.card, bench, balance))
        self._daq, port = serve(self.card, tls=settings.tls)
        for line in self._lines.values():
            line.start()
        self._control.start()
        gc.collect()
        gc.freeze()  # what is loaded by now stays: a card does not stand still for 70 ms to look for garbage
        self.card.start_background()
        self.addresses = {
            "card": f"127.0.0.1:{port}",
            **{name: server.address for name, server in self._lines.items()},
            "control": self._control.address,
        }

    def _move_block(self, bench: Bench, position_um: float) -> None:
        with self.card.at_now():
            bench.request("turn_micrometer", {"position_um": position_um})

    def close(self) -> None:
        """Stop serving."""
        servers = [*self._lines.values(), self._control]
        with ThreadPoolExecutor(len(servers)) as pool:
            list(pool.map(lambda server: server.shutdown(), servers))
        for server in servers:
            server.server_close()
        self.card.close()
        self._daq.stop(grace=0.2).wait()
