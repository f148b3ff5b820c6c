"""Start the simulated bench as a process of its own: `python -m sim_hardware`.

Settings come as TOML on stdin up to a line `# end` (the bench then lives until stdin closes, whoever holds
it), or from `--config FILE` (it then lives until SIGTERM or Ctrl-C). A JSON line on stdout says where it is.
"""

import argparse
import json
import os
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_hardware.settings import BenchSettings

END_OF_SETTINGS = "# end"
BAD_INPUT = 2


def read_settings_text(config: Path | None) -> str:
    """The settings as TOML text; ValueError, in one line, when they can't be had."""
    try:
        if config is not None:
            return config.read_text(encoding="utf-8")
        lines: list[str] = []
        for raw in sys.stdin.buffer:
            line = raw.decode("utf-8").rstrip("\r\n")
            if line == END_OF_SETTINGS:
                return "\n".join(lines)
            lines.append(line)
    except OSError as error:
        raise ValueError(f"{config}: can't be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ValueError(f"{config or 'stdin'}: is not UTF-8 text") from None
    raise ValueError(f"stdin: ended before the line {END_OF_SETTINGS!r}; end the settings with it")


def _heed_signals(ended: threading.Event, *, from_stdin: bool) -> None:
    """Let SIGTERM end the bench, and Ctrl-C where it was started by hand."""
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    # Ctrl-C at the program's terminal comes here too, while the program still needs the bench to finish.
    signal.signal(signal.SIGINT, signal.SIG_IGN if from_stdin else lambda *_: ended.set())


def _end_with_stdin(ended: threading.Event) -> None:
    """Set `ended` once nobody holds the other end of stdin any more."""
    while os.read(sys.stdin.fileno(), 4096):
        pass
    ended.set()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the bench; the process's exit code."""
    parser = argparse.ArgumentParser(prog="python -m sim_hardware", description="The simulated bench.")
    parser.add_argument("--config", type=Path, help="settings as a TOML file instead of stdin")
    config = parser.parse_args(arguments).config
    from sim_hardware.settings import BenchSettings

    try:
        settings = BenchSettings.from_toml(read_settings_text(config))
    except ValueError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return BAD_INPUT
    return run_bench(settings, from_stdin=config is None)


def run_bench(settings: "BenchSettings", *, from_stdin: bool) -> int:
    """Say where the bench is and let it live as long as it is wanted; the process's exit code."""
    ended = threading.Event()
    _heed_signals(ended, from_stdin=from_stdin)
    from sim_hardware.server.services import Services

    services = Services(settings)
    print(json.dumps(services.addresses), flush=True)
    if from_stdin:
        threading.Thread(target=_end_with_stdin, args=(ended,), daemon=True).start()
    ended.wait()
    services.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
