"""The companion: a program that a rig file names, started with the rig, which says where the devices are."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from types import TracebackType
from typing import IO, Any, Self

import tomlkit

from rig.hardware.errors import CompanionError
from rig.hardware.processes import own_group
from rig.settings.rig_file import CompanionSettings

PREFIX = "companion:"
END_OF_SETTINGS = "# end"

_STOP_S = 10.0


class Companion:
    """A running companion, as a context manager; it lives until its stdin is closed by all who hold it."""

    def __init__(self, settings: CompanionSettings) -> None:
        self._settings = settings
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the companion
        self._process: subprocess.Popen[bytes] | None = None
        self.addresses: Mapping[str, str] = {}

    def __enter__(self) -> Self:
        command = [sys.executable if word == "{python}" else word for word in self._settings.command]
        shown = " ".join(self._settings.command)
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                **own_group(),
            )
        except OSError as error:
            self._errors.close()
            raise CompanionError(
                f"companion {shown}: could not be started ({error.strerror}); check "
                "companion.command in rig.toml"
            ) from error
        try:
            self.addresses = self._introduce(self._process, shown)
        except CompanionError:
            self._process.kill()
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def pid(self) -> int:
        """Its process."""
        if self._process is None:
            raise CompanionError("the companion does not run; start it first")
        return self._process.pid

    @property
    def stdin_fd(self) -> int:
        """The pipe whose closing ends the companion; whoever else holds it keeps the companion alive."""
        if self._process is None or self._process.stdin is None:
            raise CompanionError("the companion does not run; start it first")
        return self._process.stdin.fileno()

    def resolve(self, address: str) -> str:
        """The address that "companion:NAME" stands for; any other as it is."""
        if not address.startswith(PREFIX):
            return address
        name = address.removeprefix(PREFIX)
        if name not in self.addresses:
            raise CompanionError(
                f"{address}: the companion offers only {', '.join(sorted(self.addresses))}; use one of these"
            )
        return self.addresses[name]

    def close(self) -> None:
        """Close its stdin and wait for its end."""
        process, self._process = self._process, None
        if process is None:
            return
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._errors.close()

    def _introduce(self, process: subprocess.Popen[bytes], shown: str) -> Mapping[str, str]:
        """Hand over the settings and read the line that says where everything is."""
        assert process.stdin is not None
        assert process.stdout is not None
        text = tomlkit.dumps(_plain(self._settings.settings))
        try:
            process.stdin.write(f"{text.rstrip()}\n{END_OF_SETTINGS}\n".encode())
            process.stdin.flush()
        except BrokenPipeError:
            raise CompanionError(f"companion {shown}: {self._last_words(process)}") from None
        line: list[bytes] = []
        stdout = process.stdout
        reader = threading.Thread(target=lambda: line.append(stdout.readline()), daemon=True)
        reader.start()
        reader.join(self._settings.start_timeout_s)
        if not line:
            process.kill()
            reader.join()
            raise CompanionError(
                f"companion {shown}: said nothing within {self._settings.start_timeout_s:g} s; raise "
                "companion.start_timeout_s in rig.toml, or start it by hand to see why"
            )
        if not line[0]:
            raise CompanionError(f"companion {shown}: {self._last_words(process)}")
        try:
            addresses = json.loads(line[0])
        except ValueError:
            addresses = None
        if not isinstance(addresses, dict) or not all(isinstance(item, str) for item in addresses.values()):
            raise CompanionError(
                f"companion {shown}: its first line is no table of addresses: {line[0][:60]!r}; "
                "check companion.command in rig.toml"
            )
        return addresses

    def _last_words(self, process: subprocess.Popen[bytes]) -> str:
        try:
            code: int | str = process.wait(2.0)
        except subprocess.TimeoutExpired:
            code = "unknown"
        self._errors.seek(0)
        lines = self._errors.read().decode("utf-8", "replace").strip().splitlines()
        return f"ended at once (exit code {code}): {lines[-1] if lines else 'no reason given'}"


def _plain(value: Any) -> Any:
    """Tables and lists as TOML writers take them."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value
