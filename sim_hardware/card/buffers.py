"""The two buffers of the driver: a ring that the acquisition fills, a queue that the generation plays."""

import numpy as np

from sim_hardware.card.plant import FloatArray


class InputRing:
    """Ring of acquired samples, (n_channels, size); the acquisition never waits for the reader."""

    def __init__(self, n_channels: int, size: int) -> None:
        self._data = np.zeros((n_channels, size))
        self.size = size
        self.acquired = 0
        self.read_position = 0

    @property
    def available(self) -> int:
        """Samples a channel that were acquired and not yet read (more than `size` once overwritten)."""
        return self.acquired - self.read_position

    @property
    def overwritten(self) -> bool:
        """Whether the next sample to read is gone."""
        return self.available > self.size

    def store(self, block: FloatArray) -> None:
        """Add acquired samples, shape (n_channels, n), over the oldest ones."""
        n = block.shape[1]
        kept = block[:, max(0, n - self.size) :]
        start = (self.acquired + n - kept.shape[1]) % self.size
        head = min(kept.shape[1], self.size - start)
        self._data[:, start : start + head] = kept[:, :head]
        self._data[:, : kept.shape[1] - head] = kept[:, head:]
        self.acquired += n

    def take(self, n: int) -> FloatArray:
        """The next n samples, shape (n_channels, n); n is at most `available`."""
        start = self.read_position % self.size
        head = min(n, self.size - start)
        self.read_position += n
        first = self._data[:, start : start + head]
        return first.copy() if head == n else np.hstack([first, self._data[:, : n - head]])


class OutputQueue:
    """Samples the host has written and the card has yet to play, (n_channels, size).

    With regeneration the queue is played round and round; without, each sample is played once.
    """

    def __init__(self, n_channels: int, size: int, *, regenerate: bool) -> None:
        self._data = np.zeros((n_channels, size))
        self.size = size
        self.regenerate = regenerate
        self.written = 0
        self.generated = 0

    @property
    def room(self) -> int:
        """Samples a channel that can be written now without losing one that was not yet played."""
        return min(self.size, self.size - (self.written - self.generated))

    def write(self, samples: FloatArray) -> None:
        """Append samples, shape (n_channels, n), n at most `room`."""
        n = samples.shape[1]
        start = self.written % self.size
        head = min(n, self.size - start)
        self._data[:, start : start + head] = samples[:, :head]
        self._data[:, : n - head] = samples[:, head:]
        self.written += n

    def take(self, n: int) -> FloatArray:
        """Play up to n samples, shape (n_channels, m); m < n where the queue runs dry."""
        filled = min(self.written, self.size)
        if not filled:
            return self._data[:, :0]
        if not self.regenerate:
            n = min(n, self.written - self.generated)
        indices = np.arange(self.generated, self.generated + n) % filled
        self.generated += n
        taken: FloatArray = self._data[:, indices]
        return taken

    def rewind(self) -> None:
        """Back to the first sample, as a stop does; without regeneration nothing is left to play again."""
        self.generated = 0
        if not self.regenerate:
            self.written = 0
