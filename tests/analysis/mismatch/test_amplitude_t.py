"""A t over trials keeps its level over all probes together, and sees what flips of so few trials cannot."""

import numpy as np
from scipy.stats import binom

from analysis.mismatch.amplitude_t import amplitude_p_value, moderated
from analysis.mismatch.signatures import Probe, Signatures
from analysis.simulation.mechanism import library

TRIALS, PROBES, STUDIES = 20, 40, 300


def _signatures(rng: np.random.Generator, strength: float = 0.0, scale: float = 1.0) -> Signatures:
    """Scores of correlated probes that live in trials unevenly; the first has an effect of a strength."""
    mixing = rng.normal(size=(8, PROBES))
    size = np.geomspace(1.0, 3.0, TRIALS)
    gram = np.sum(size**2) * mixing.T @ mixing
    norm2 = size[:, None] ** 2 * np.diag(mixing.T @ mixing)
    scores = scale * size[:, None] * (rng.normal(size=(TRIALS, 8)) @ mixing)
    scores += strength / np.sqrt(gram[0, 0]) * size[:, None] ** 2 * (mixing.T @ mixing)[0]
    laws = [m for m in library().values() if m.form == "law"]
    probes = tuple(Probe(laws[k % len(laws)], {}) for k in range(PROBES))
    nothing = np.zeros((0, PROBES))
    norm = np.sqrt(np.diag(gram))
    return Signatures(probes, scores, np.zeros((TRIALS, 0)), scores, gram, norm, norm2, nothing)


def test_level_holds_over_all_probes_together_whatever_the_size_of_the_noise() -> None:
    for scale in (1.0, 30.0):
        rng = np.random.default_rng(1)
        alarms = sum(
            bool(amplitude_p_value(_signatures(rng, scale=scale), rng).min() <= 0.02) for _ in range(STUDIES)
        )
        # 1 in 100,000 is the chance that a test of level 0.02 fails here by chance
        assert alarms <= binom.ppf(1 - 1e-5, STUDIES, 0.02), scale


def test_a_strong_effect_has_a_p_value_that_flips_of_twenty_trials_do_not_reach() -> None:
    rng = np.random.default_rng(2)
    found = [amplitude_p_value(_signatures(rng, strength=8.0), rng)[0] for _ in range(20)]
    assert np.median(found) <= 2e-4


def test_variances_of_few_are_drawn_towards_those_of_all() -> None:
    rng = np.random.default_rng(3)
    freedom = np.full(200, 3.0)
    alike = rng.chisquare(3.0, 200) / 3.0
    drawn, more = moderated(alike, freedom)
    assert np.std(drawn) < 0.4 * np.std(alike)
    assert np.all(more > 10.0)
    unlike = alike * np.exp(rng.normal(0.0, 2.0, 200))
    kept, few = moderated(unlike, freedom)
    assert np.all(few < 6.0)
    assert kept[np.argmax(unlike)] > 0.5 * unlike.max()
