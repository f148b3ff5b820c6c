"""Settings of the bench: what is right is read, what is wrong is one line."""

from __future__ import annotations

import pytest

from sim_hardware.settings import BenchSettings


def test_defaults_are_the_published_bench() -> None:
    settings = BenchSettings.from_toml("")
    assert settings.tissue.k0_mn_per_mm == 120.0
    assert settings.tissue.k1 == pytest.approx(0.371 * 120)
    assert settings.tissue.k2 == pytest.approx(0.294 * 120)
    assert settings.lever.natural_frequency_rad_s == 5.0e3
    assert settings.converters.bits == 16
    assert settings.time == "real"


def test_arms_follow_k0_unless_given() -> None:
    settings = BenchSettings.from_toml("[tissue]\nk0_mn_per_mm = 200.0\nk1_mn_per_mm = 10.0")
    assert settings.tissue.k1 == 10.0
    assert settings.tissue.k2 == pytest.approx(0.294 * 200)


def test_the_brief_example_is_read() -> None:
    settings = BenchSettings.from_toml(
        """
        seed = 1
        time = "virtual"
        loopback_wired = true
        late_start_samples = 7
        [[faults]]
        kind = "stall"
        at_s = 3.0
        duration_s = 0.5
        [tissue]
        tau1_s = 3
        [[effects]]
        name = "adhesion"
        pull_off_mn = 4.2
        """
    )
    assert settings.effects[0].given == {"pull_off_mn": 4.2}
    assert settings.faults[0].kind == "stall"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seed = -1", ["seed", "-1"]),
        ("seed = 1.5", ["seed"]),
        ("seed =", ["TOML"]),
        ('time = "soon"', ["time", "soon"]),
        ("sed = 1", ["unknown key 'sed'"]),
        ("[tissue]\nk0_mn_per_mm = -3.0", ["tissue.k0_mn_per_mm", "-3.0", "mN/mm"]),
        ("[tissue]\nk0_mn_per_mm = nan", ["tissue.k0_mn_per_mm", "mN/mm"]),
        ("[tissue]\ntau1_s = 0.0", ["tissue.tau1_s", "(s)"]),
        ("[tissue]\nk0_n_per_m = 3.0", ["unknown key 'tissue.k0_n_per_m'"]),
        ("[noise]\nforce_mn_rms = -0.1", ["noise.force_mn_rms", "mN"]),
        ("[lever]\nnatural_frequency_rad_s = 1.0", ["rad/s"]),
        ("[specimens]\nsurface_low_mm = 6.0\nsurface_high_mm = 3.0", ["surface_high_mm"]),
        ("substeps = 2", ["substeps"]),
        ('[[effects]]\nname = "gremlins"', ["unknown effect 'gremlins'", "adhesion"]),
        ('[[effects]]\nname = "adhesion"\npull_of_mn = 3.0', ["adhesion", "unknown parameter 'pull_of_mn'"]),
        ('[[effects]]\nname = "adhesion"\npull_off_mn = "4"', ["adhesion", "pull_off_mn", "mN"]),
        ('[[effects]]\nname = "adhesion"\npull_off_mn = inf', ["adhesion", "pull_off_mn", "mN"]),
        ('[[effects]]\nname = "adhesion"\nrough = 2.0', ["rough"]),
        ("[[effects]]\npull_off_mn = 4.2", ["name"]),
        ('[[faults]]\nkind = "flood"', ["faults.0.kind", "flood"]),
        ("effects = 3", ["effects = 3", "list of tables"]),
        ("effects = [1]", ["effects.0", "table"]),
        ("tissue = 3", ["tissue = 3", "table"]),
    ],
)
def test_what_is_wrong_is_one_line(text: str, words: list[str]) -> None:
    with pytest.raises(ValueError) as caught:
        BenchSettings.from_toml(text)
    message = str(caught.value)
    assert type(caught.value) is ValueError
    assert "\n" not in message
    assert message.startswith("bench settings: ")
    for word in words:
        assert word in message
