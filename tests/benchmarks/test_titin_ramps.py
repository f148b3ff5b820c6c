"""One muscle stretched in 0.1, 1, 10 and 100 s: each ramp fitted, the others predicted; `pytest -m benchmark -s`."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from analysis.recordings.importing import import_recordings
from analysis.relaxation.batch import fit_paths

pytestmark = pytest.mark.benchmark
RAMPS = Path(__file__).parents[2].parent / "shared" / "recordings" / "titin_ramps"


@pytest.mark.skipif(not RAMPS.is_dir(), reason="the real recordings are not beside the project")
def test_one_ramp_fitted_the_others_predicted(tmp_path: Path):
    files = []
    for seconds in ("0.1", "1", "10", "100"):
        target = tmp_path / f"titin_{seconds}s.csv"
        with (RAMPS / f"AvgRelaxed_{seconds}s.csv").open(newline="") as read:
            rows = [f"{float(r['Time']) - 2.0},{float(r['L']) - 0.95},{r['F']}" for r in csv.DictReader(read)]
        target.write_text("\n".join(["time_s,position_mm,force_mn", *rows]) + "\n")
        files.append(target)
    imported, _ = import_recordings(files, tmp_path / "trials")
    fit_paths([one.path for one in imported], out=tmp_path / "out", jobs=1)
    document = json.loads((tmp_path / "out" / "fits.json").read_text())
    print("\neach ramp fitted (position is stretch over L0, force kPa)")
    for trial in document["trials"]:
        if trial["failure"]:
            print(f"  {trial['file']:16s} {trial['flags']}")
        else:
            times = f"t1 {trial['t1_s']['value']:.3g} s, t2 {trial['t2_s']['value']:.3g} s"
            print(f"  {trial['file']:16s} R2 {trial['r2']:.4f}, {times}; flags: {trial['flags']}")
    print("and asked for the others: force missed (rms, share of its range), peak, R2 that hides it")
    for said in document["other_ramps"]:
        print(
            f"  {said['fitted']:16s} -> {said['other']:16s} {said['rms_mn']:6.3f} kPa {100 * said['share']:5.1f} %, "
            f"peak {100 * said['peak_share']:+6.1f} %, R2 {said['r2']:.3f}{'  flagged' if said['failed'] else ''}"
        )
    # four ramps, each asked for the three others, also those whose own fit was refused
    assert len(document["other_ramps"]) == 12
    assert all(said["failed"] for said in document["other_ramps"] if said["share"] > 0.035)
    assert all("other_ramp_missed=" in trial["flags"] for trial in document["trials"])
