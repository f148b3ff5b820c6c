"""Sign-flips keep their level whatever the noise, and see what is there."""

import numpy as np
from scipy.stats import binom

from analysis.mismatch.evidence.signflip import flip_test

TRIALS, CANDIDATES, STUDIES = 20, 60, 300


def _false_alarms(noise: str, level: float) -> int:
    rng = np.random.default_rng(11)
    mixing = rng.normal(size=(8, CANDIDATES))
    alarms = 0
    for _ in range(STUDIES):
        scores = rng.normal(size=(TRIALS, 8)) @ mixing
        if noise == "heavy":
            scores *= rng.standard_t(2.5, size=(TRIALS, 1))
        if noise == "uneven":
            scores *= np.geomspace(1, 30, TRIALS)[:, None]
        test = flip_test(scores, np.arange(CANDIDATES) % 2 == 0, rng)
        alarms += bool(test.p_value.min() <= level)
    return alarms


def test_level_holds_over_all_candidates_together() -> None:
    # 1 in 100,000 is the chance that a test of level 0.05 fails here by chance, for each kind of noise
    bound = binom.ppf(1 - 1e-5, STUDIES, 0.05)
    for noise in ("gaussian", "heavy", "uneven"):
        assert _false_alarms(noise, 0.05) <= bound, noise


def test_an_effect_in_every_trial_is_seen_and_the_right_one_is_the_largest() -> None:
    rng = np.random.default_rng(5)
    scores = rng.normal(size=(TRIALS, CANDIDATES))
    scores[:, 7] += 3.0
    test = flip_test(scores, np.ones(CANDIDATES, dtype=bool), rng)
    assert int(np.argmax(test.statistic)) == 7
    assert test.p_value[7] < 0.001
    assert np.sort(test.p_value)[1] > 0.05


def test_one_sided_candidates_ignore_the_other_sign() -> None:
    rng = np.random.default_rng(6)
    scores = rng.normal(size=(TRIALS, 2)) - 4.0
    test = flip_test(scores, np.array([True, False]), rng)
    assert test.p_value[0] > 0.9
    assert test.p_value[1] < 0.001
