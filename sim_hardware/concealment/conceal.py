"""Keeps what concealed benches hide until it is asked to open: `python -m sim_hardware.concealment.conceal`.

`keep --cases N --seed S` reads the study that will be recorded as a JSON line from stdin, a list of
`{"finger": "index", "site": "1", "repeat": 1, "depth_mm": 0.4, "rest_s": 150.0}`, draws cases, and prints a
JSON line a case, `{"case": 0, "seal": "..."}`, then `{"address": "http://127.0.0.1:PORT"}`. From then on it
holds the truth in its own memory alone, hands the settings of each case out once, to the bench that is to hide
them, and lives until its stdin closes. The line `open` on stdin makes it hand out nothing more, print
`{"case": 0, "salt": "...", "truth": "..."}` for every case, and end.

`bench ADDRESS NUMBER` is the companion of a rig: a simulated bench that gets its settings from the keeper.
"""

import argparse
import json
import sys
import threading
from collections.abc import Sequence
from typing import cast
from xmlrpc.client import Fault, ServerProxy
from xmlrpc.server import SimpleXMLRPCServer

BAD_INPUT = 2


class Keeper:
    """Hands out each case's settings once."""

    def __init__(self, settings: Sequence[str]) -> None:
        self._settings: list[str | None] = list(settings)
        self._lock = threading.Lock()

    def hand_out(self, number: int) -> str:
        """Return a case's settings as JSON; ValueError when they were handed out, or never will be."""
        with self._lock:
            if not 0 <= number < len(self._settings):
                raise ValueError(f"case {number}: there are {len(self._settings)}")
            text = self._settings[number]
            if text is None:
                raise ValueError(f"case {number}: was handed out already")
            self._settings[number] = None
            return text

    def close(self) -> None:
        """Hand out nothing more."""
        with self._lock:
            self._settings = [None] * len(self._settings)


def keep(cases: int, seed: int) -> int:
    """Draw, seal, hand out, and open when asked to."""
    from sim_hardware.concealment.cases import draw_cases
    from sim_hardware.concealment.plans import TrialPlan
    from sim_hardware.concealment.sealing import seal

    plans = [TrialPlan(**plan) for plan in json.loads(sys.stdin.readline())]
    sealed, settings = [], []
    for case in draw_cases(cases, seed, plans):
        sealed.append(seal(case.truth()))
        settings.append(case.settings.model_dump_json())
        _say({"case": case.number, "seal": sealed[-1].seal})
    keeper = Keeper(settings)
    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        server.register_function(lambda number: keeper.hand_out(int(cast(int, number))), "hand_out")
        threading.Thread(target=server.serve_forever, daemon=True).start()
        _say({"address": f"http://127.0.0.1:{server.server_address[1]}"})
        opened = any(line.strip() == "open" for line in iter(sys.stdin.readline, ""))
        keeper.close()
        server.shutdown()
    if opened:
        for number, one in enumerate(sealed):
            _say({"case": number, "salt": one.salt, "truth": one.text})
    return 0


def bench(address: str, number: int) -> int:
    """Run the bench of one case as a rig's companion: addresses on stdout, alive until stdin closes."""
    from sim_hardware.__main__ import run_bench
    from sim_hardware.settings import BenchSettings

    try:
        text = cast(str, ServerProxy(address).hand_out(number))
        settings = BenchSettings.model_validate_json(text)
    except (OSError, Fault, ValueError) as error:
        words = error.faultString if isinstance(error, Fault) else str(error)
        print(" ".join(f"concealed bench: {words}".split()), file=sys.stderr)
        return BAD_INPUT
    return run_bench(settings, from_stdin=True)


def _say(line: dict[str, object]) -> None:
    print(json.dumps(line), flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the keeper or a concealed bench; the process's exit code."""
    parser = argparse.ArgumentParser(prog="python -m sim_hardware.concealment.conceal", description=__doc__)
    parts = parser.add_subparsers(dest="part", required=True)
    keeping = parts.add_parser("keep", help="draw cases and keep what they hide")
    keeping.add_argument("--cases", type=int, required=True)
    keeping.add_argument("--seed", type=int, default=0)
    hiding = parts.add_parser("bench", help="a bench that hides what the keeper tells it")
    hiding.add_argument("address")
    hiding.add_argument("number", type=int)
    given = parser.parse_args(arguments)
    return keep(given.cases, given.seed) if given.part == "keep" else bench(given.address, given.number)


if __name__ == "__main__":
    sys.exit(main())
