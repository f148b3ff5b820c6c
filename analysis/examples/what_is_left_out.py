"""Diagnose a study, and print what the simulation leaves out and what that would cost a fit.

python -m analysis.examples.what_is_left_out my-study my-diagnosis
"""

from __future__ import annotations

import sys
from pathlib import Path

from analysis import diagnose


def main(folder: Path, out: Path) -> None:
    """Print the verdict, the mechanisms with their parameters, and the gain on trials held out."""
    report = diagnose(folder, out=out)
    print(f"{report['verdict']}: {report['summary']}")
    for mechanism in report["mechanisms"]:
        print(f"  {mechanism['name']} (p = {mechanism['p_value']:.2g})")
        for name, parameter in mechanism["parameters"].items():
            print(f"    {name} = {parameter['value']:.4g} +- {parameter['se']:.2g} {parameter['unit']}")
    held = report["heldout"]
    print(
        f"residual on trials held out: {held['baseline_rms_mn']:.3g} -> {held['improved_rms_mn']:.3g} mN rms"
    )
    print(f"the page: {out / 'report.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
