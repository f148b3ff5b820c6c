"""The balance that weighs the calibration weights: MT-SICS level 0 (S, SI, Z, ZI, @, I0 to I4)."""

from collections.abc import Callable

import numpy as np

CAPACITY_G = 220.0
SETTLING_S = 1.5
NOISE_G = 0.1e-3
_COMMANDS = ["@", "I0", "I1", "I2", "I3", "I4", "S", "SI", "Z", "ZI"]
_IDENTITY = ['I4 A "B300000001"']
_FIXED = {
    "@": _IDENTITY,
    "I4": _IDENTITY,
    "I0": [f'I0 {"A" if name == _COMMANDS[-1] else "B"} 0 "{name}"' for name in _COMMANDS],
    "I1": ['I1 A "0" "2.00" "" "" ""'],
    "I2": [f'I2 A "Simulated balance {CAPACITY_G:.4f} g"'],
    "I3": ['I3 A "1.00"'],
}


class Balance:
    """Shows what lies on the pan; stable once the load has been still for a while of the bench's time."""

    def __init__(self, time_s: Callable[[], float], sleep: Callable[[float], None], *, seed: int = 0) -> None:
        self._time_s = time_s
        self._sleep = sleep
        self._noise = np.random.default_rng((seed, 0xBA1))
        self._zero_g = float(self._noise.normal(0.0, 0.002))
        self._load_g = 0.0
        self._loaded_s = -np.inf

    def put(self, mass_g: float) -> None:
        """Put a mass on the empty pan, 0 to clear it; ValueError for a mass below zero."""
        if not mass_g >= 0:
            raise ValueError(f"mass_g = {mass_g}: a mass is not below zero (g)")
        self._load_g, self._loaded_s = mass_g, self._time_s()

    def _unrest_g(self) -> float:
        """How far the display still is from its end, falling with the time since the load."""
        age_s = self._time_s() - self._loaded_s
        return 0.0 if age_s > SETTLING_S else 0.05 * float(np.exp(-age_s / 0.3))

    def _weight(self, stability: str) -> str:
        gross_g = self._load_g + self._unrest_g()
        if gross_g > CAPACITY_G:
            return "S +"
        shown_g = gross_g + float(self._noise.normal(0.0, NOISE_G)) - self._zero_g
        return f"S {stability} {shown_g:11.4f} g"

    def _settle(self) -> None:
        """Wait until the load has been still long enough."""
        wait_s = self._loaded_s + SETTLING_S - self._time_s()
        if wait_s > 0:
            self._sleep(wait_s + 0.001)

    def answer(self, line: str) -> list[str]:
        """The reply to one command line."""
        moving = self._time_s() - self._loaded_s <= SETTLING_S
        if line in {"S", "Z"}:
            self._settle()
            moving = False
        if line in {"S", "SI"}:
            return [self._weight("D" if moving else "S")]
        if line in {"Z", "ZI"}:
            self._zero_g = self._load_g + self._unrest_g()
            return ["Z A"] if line == "Z" else [f"ZI {'D' if moving else 'S'}"]
        return _FIXED.get(line, ["ES"])
