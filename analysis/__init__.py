"""What can be done on a laptop, without the rig: trial files, fits, the simulation and its mismatch.

For scripts and notebooks:

>>> from analysis import read_trial, fit_trial, diagnose
>>> fit = fit_trial(read_trial("my-study/003_index_0.40mm_r1.h5"))    # doctest: +SKIP
>>> fit.estimates["t1_s"]                                             # doctest: +SKIP
Estimate(value=2.271, se=0.012)

Nothing heavy is loaded before it is used. What goes wrong with a file is a `BadInputError`: one line, what, where
and what to do.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from analysis.errors import BadInputError
    from analysis.interface import diagnose
    from analysis.recordings.folders import find_trials
    from analysis.recordings.importing import import_recordings
    from analysis.recordings.reading import read_trial
    from analysis.recordings.trial import Trial
    from analysis.relaxation.fit import fit_trial
    from analysis.relaxation.result import Estimate, TrialFit

__all__ = [
    "BadInputError",
    "Estimate",
    "Trial",
    "TrialFit",
    "diagnose",
    "find_trials",
    "fit_trial",
    "import_recordings",
    "read_trial",
]

_HOMES = {
    "BadInputError": "errors",
    "Estimate": "relaxation.result",
    "Trial": "recordings.trial",
    "TrialFit": "relaxation.result",
    "diagnose": "interface",
    "find_trials": "recordings.folders",
    "fit_trial": "relaxation.fit",
    "import_recordings": "recordings.importing",
    "read_trial": "recordings.reading",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
