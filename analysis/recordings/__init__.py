"""The trial file: layout, writer, reader, importers.

`layout` declares every attribute once; `reading` and `writing` walk it. `live` keeps a running trial on disk
and brings back what a kill cut off, `importing` takes other programs' recordings by way of `importers`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from analysis.recordings.folders import find_trials
    from analysis.recordings.live.header import TrialHeader
    from analysis.recordings.live.trial_writer import TrialWriter
    from analysis.recordings.reading import read_trial
    from analysis.recordings.writing import mark_discarded, write_trial

__all__ = ["TrialHeader", "TrialWriter", "find_trials", "mark_discarded", "read_trial", "write_trial"]

_HOMES = {
    "find_trials": "folders",
    "read_trial": "reading",
    "TrialHeader": "live.header",
    "TrialWriter": "live.trial_writer",
    "mark_discarded": "writing",
    "write_trial": "writing",
}


def __getattr__(name: str) -> Any:
    # h5py is loaded with the first use, so that importing the package stays cheap
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
