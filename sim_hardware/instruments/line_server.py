"""A serial instrument on a TCP port: lines in, lines out, as pyserial's `socket://` sees it."""

import socketserver
import threading
from typing import Protocol

LONGEST_LINE = 256


class LineInstrument(Protocol):
    """What speaks over the line."""

    def answer(self, line: str) -> list[str]:
        """Replies to one line, without line ends; empty for silence."""


class _Handler(socketserver.StreamRequestHandler):
    disable_nagle_algorithm = True

    def handle(self) -> None:
        server = self.server
        assert isinstance(server, LineServer)
        while raw := self.rfile.readline(LONGEST_LINE):
            line = raw.decode("ascii", errors="replace").strip()
            with server.line_lock:
                replies = server.instrument.answer(line) if line else []
            for reply in replies:
                self.wfile.write(reply.encode("ascii", errors="replace") + b"\r\n")


class LineServer(socketserver.ThreadingTCPServer):
    """Serves one instrument on the loopback interface; clients may come and go."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, instrument: LineInstrument, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.instrument = instrument
        self.line_lock = threading.Lock()

    @property
    def address(self) -> str:
        """Where pyserial's `serial_for_url` finds it."""
        return f"socket://127.0.0.1:{self.server_address[1]}"

    def start(self) -> None:
        """Serve in the background until `shutdown`."""
        threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True).start()

    def handle_error(self, request: object, client_address: object) -> None:
        """A client that went away in the middle of a line is no event."""
