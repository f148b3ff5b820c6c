"""How strong an effect must be to be seen, against the test that knows its shape."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

import detection

from analysis.mismatch.signflip import flip_test
from rig.proof.scores import decibel, matched_strength, strength_at

NAMES = ("adhesion", "viscous_friction", "third_relaxation", "force_drift", "heartbeat", "slip")
STRENGTHS = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
LEVEL = 0.01


@pytest.mark.benchmark
@pytest.mark.parametrize("name", NAMES)
def test_strength_at_half_and_most_detections(name: str) -> None:
    """INDENTER_REPLICATES a strength (8 by default: 50 replicates tell the points to 0.5 dB, 8 to 1 dB)."""
    replicates = int(os.environ.get("INDENTER_REPLICATES", "8"))
    study = detection.study_with(name, seed=17)
    random = np.random.default_rng(5)
    false_alarms = [detection.detects(study, 0.0, random) for _ in range(replicates)]
    tried = [(s, detection.detects(study, s, random)) for s in STRENGTHS for _ in range(replicates)]
    shares = {s: np.mean([seen for at, seen in tried if at == s]) for s in STRENGTHS}
    print(f"\n{name}: false alarms {sum(false_alarms)} of {replicates};", end=" ")
    print(", ".join(f"{s:g}: {share:.0%}" for s, share in shares.items()))
    for power in (0.5, 0.9):
        reached = strength_at(power, [s for s, _ in tried], [seen for _, seen in tried])
        ideal = matched_strength(power, LEVEL)
        if reached is None:
            print(f"  {power:.0%}: beyond {STRENGTHS[-1]:g}")
            continue
        print(
            f"  {power:.0%} detected at strength {reached:.2f}; the matched test at a false alarm rate of "
            f"{LEVEL:.0%}: {ideal:.2f}; {decibel(reached / ideal):.1f} dB"
        )
    assert np.mean(false_alarms) < 0.5


@pytest.mark.benchmark
def test_what_sign_flips_cost_by_themselves() -> None:
    """One candidate of known shape, its scores flipped over 20 trials: 2000 replicates tell it to 0.1 dB."""
    random = np.random.default_rng(8)
    strengths = random.uniform(1.0, 7.0, 2000)
    seen = []
    for s in strengths:
        scores = s / np.sqrt(20) + random.standard_normal((20, 1))
        test = flip_test(scores, np.ones(1, dtype=bool), random)
        seen.append(bool(test.p_value[0] <= LEVEL))
    for power in (0.5, 0.9):
        reached = strength_at(power, strengths.tolist(), seen)
        assert reached is not None
        ratio = reached / matched_strength(power, LEVEL)
        print(f"\nsign-flips over 20 trials, {power:.0%}: {reached:.2f}, {decibel(ratio):.1f} dB", end="")
        assert decibel(ratio) < 2.0
