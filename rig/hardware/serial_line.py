"""A device that answers lines of text: COM port, pseudo-terminal or socket:// alike."""

from __future__ import annotations

import serial

from rig.hardware.errors import SerialDeviceError


class SerialLine:
    """Sends one line, reads one line. ``device`` names it in messages; ``port`` as pyserial takes it."""

    def __init__(self, device: str, port: str, *, baud_rate: int, timeout_s: float = 5.0) -> None:
        self._name = f"{device} at {port}"
        try:
            self._port = serial.serial_for_url(port, baudrate=baud_rate, timeout=timeout_s)
        except (serial.SerialException, OSError, ValueError) as error:
            raise SerialDeviceError(
                f"{self._name}: can't be opened ({error}); check its cable, power and port in rig.toml"
            ) from error

    def send(self, line: str, end: str) -> None:
        """Send a line in ASCII."""
        try:
            self._port.write((line + end).encode("ascii"))
        except (serial.SerialException, OSError) as error:
            raise self.failure(f"did not take {line!r} ({error})") from error

    def read(self, timeout_s: float | None = None) -> str:
        """The next line without its end; SerialDeviceError after the timeout."""
        try:
            if timeout_s is not None:
                self._port.timeout = timeout_s
            raw = self._port.read_until(b"\n")
        except (serial.SerialException, OSError) as error:
            raise self.failure(f"the connection broke ({error})") from error
        if not raw.endswith(b"\n"):
            raise self.failure("did not answer in time")
        return bytes(raw).decode("ascii", "replace").strip("\r\n")

    def failure(self, what: str) -> SerialDeviceError:
        """What went wrong with this device, as an error to raise."""
        return SerialDeviceError(f"{self._name}: {what}; check its cable, its power and its settings")

    def close(self) -> None:
        """Close the port."""
        self._port.close()
