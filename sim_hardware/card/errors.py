"""The driver's error codes that the simulated card answers with, and what the driver says to each."""

from enum import IntEnum


class Code(IntEnum):
    """Status codes of NI-DAQmx that the simulated card gives where the driver would."""

    RESOURCE_RESERVED = -50103
    TERMINAL_NOT_FOUND = -89120
    TASK_ABORTED = -88710
    INVALID_TASK = -200088
    INVALID_VALUE = -200077
    NO_SUCH_CHANNEL = -200170
    NO_SUCH_DEVICE = -200220
    READ_ARRAY_TOO_SMALL = -200229
    NEVER_AVAILABLE = -200278
    OVERWRITTEN = -200279
    NOT_YET_AVAILABLE = -200284
    OUTPUT_STARVED = -200290
    NOT_YET_WRITABLE = -200292
    PROPERTY_NOT_SUPPORTED = -200452
    NO_OUTPUT_CHANNELS = -200459
    NO_INPUT_CHANNELS = -200460
    OUTPUT_EMPTY = -200462
    NO_CHANNELS = -200478
    RUNNING = -200479
    CHANNEL_TWICE = -200489
    CHANNEL_COUNT_MISMATCH = -200524
    NOT_DONE = -200560
    OUTPUT_OUT_OF_RANGE = -200561
    MIXED_DIRECTIONS = -200559
    DEVICE_GONE = -201003


MESSAGES: dict[int, str] = {
    Code.RESOURCE_RESERVED: (
        "The specified resource is reserved. The operation could not be completed as specified."
    ),
    Code.TERMINAL_NOT_FOUND: "Source terminal to be routed could not be found on the device.",
    Code.TASK_ABORTED: (
        "The specified operation was aborted: the task was stopped or cleared, or its device was reset."
    ),
    Code.INVALID_TASK: "Task specified is invalid or does not exist.",
    Code.INVALID_VALUE: "Requested value is not a supported value for this property.",
    Code.NO_SUCH_CHANNEL: "Physical channel specified does not exist on this device.",
    Code.NO_SUCH_DEVICE: "Device identifier is invalid.",
    Code.READ_ARRAY_TOO_SMALL: "Buffer is too small to fit read data.",
    Code.NEVER_AVAILABLE: "Attempted to read a sample beyond the final sample acquired.",
    Code.OVERWRITTEN: (
        "The application is not able to keep up with the hardware acquisition: "
        "unread samples were overwritten in the buffer."
    ),
    Code.NOT_YET_AVAILABLE: "Some or all of the samples requested have not yet been acquired.",
    Code.OUTPUT_STARVED: (
        "The generation has stopped to prevent the regeneration of old samples: "
        "new samples were not written in time."
    ),
    Code.NOT_YET_WRITABLE: "Some or all of the samples to write could not be written to the buffer yet.",
    Code.PROPERTY_NOT_SUPPORTED: (
        "Specified property is not supported by the device or is not applicable to the task."
    ),
    Code.NO_OUTPUT_CHANNELS: "Write failed, because there are no output channels in this task.",
    Code.NO_INPUT_CHANNELS: "Read failed, because there are no input channels in this task.",
    Code.OUTPUT_EMPTY: "Generation cannot be started, because the output buffer is empty.",
    Code.NO_CHANNELS: "Specified operation cannot be performed when there are no channels in the task.",
    Code.RUNNING: "Specified operation cannot be performed while the task is running.",
    Code.CHANNEL_TWICE: "Specified channel cannot be added to the task, because it is already in the task.",
    Code.CHANNEL_COUNT_MISMATCH: (
        "Write cannot be performed, because the number of samples does not match the channels in the task."
    ),
    Code.NOT_DONE: "Wait until done did not indicate that the task was done within the specified timeout.",
    Code.OUTPUT_OUT_OF_RANGE: "Attempted to write a voltage that is outside the range of the output channel.",
    Code.MIXED_DIRECTIONS: "Channels of different directions cannot be put into one task.",
    Code.DEVICE_GONE: (
        "Device cannot be accessed. The device is no longer present in the system or is not powered."
    ),
}


class CardError(Exception):
    """A call the card refuses or can't complete.

    code: the driver's status; n_read, n_written: samples a channel that still got through, where that means
    something; detail: what in particular. The text is laid out as the driver lays out its own.
    """

    def __init__(
        self, code: int, detail: str = "", *, n_read: int | None = None, n_written: int | None = None
    ) -> None:
        self.code = int(code)
        self.n_read = n_read
        self.n_written = n_written
        message = MESSAGES.get(self.code, "Unspecified error.")
        super().__init__("\n\n".join(filter(None, [message, detail, f"Status Code: {self.code}"])))
