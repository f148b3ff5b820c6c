"""The `indenter` command: parses, calls, prints. Each command imports its work only when it is called."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn, get_args

from analysis.errors import BadInputError
from rig.errors import RigError

EXIT_OK, EXIT_RUN_FAILED, EXIT_BAD_INPUT, EXIT_INTERRUPTED = 0, 1, 2, 130


_IMPORT_HELP = """Turn recordings of other programs into trial files, and say what was found.

.ddf (Aurora DMC), AFM files, and tables: .csv, .txt, .tsv, .xlsx, .xls, .ods. A table has a column each for
  time      in us, ms, s, min or h
  position  in nm, um, mm, cm, m or in, positive into the specimen
  force     in pN, nN, uN, mN, N, kN, gf or kgf, positive in compression
  command   commanded position, optional
A header such as "Force (N)" is understood by itself; otherwise say it:
  --column force="Channel 3" --unit force=-N      (the minus: compression is negative there)
A column may be given by its number, from 1. Tables of several trials, and what differs from file to file, stand
in a mapping file, which README shows."""


class _OneLineParser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(EXIT_BAD_INPUT, f"{self.prog}: {message} (see {self.prog} --help)\n")


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from importlib.metadata import version

        print("indenter", version("indenter"))
        parser.exit(EXIT_OK)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0 success, 1 run failed, 2 bad input, 130 interrupted."""
    # the matrices here are small: threads of the linear algebra would only spin beside each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    _stand_in_for_closed()
    try:
        arguments = _parser().parse_args(argv)
        return _COMMANDS[arguments.command](arguments) or EXIT_OK
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else EXIT_BAD_INPUT
    except BadInputError as error:
        return _failed(EXIT_BAD_INPUT, error)
    except RigError as error:
        return _failed(EXIT_RUN_FAILED, error)
    except KeyboardInterrupt as error:
        return _failed(EXIT_INTERRUPTED, str(error) or "interrupted")
    except BrokenPipeError:
        return EXIT_RUN_FAILED


def _stand_in_for_closed() -> None:
    """Open something in place of standard streams that this was started without: pipes must not take their numbers."""
    while (fd := os.open(os.devnull, os.O_RDWR)) <= 2:  # the lowest that is free
        os.set_inheritable(fd, True)
    os.close(fd)


def _failed(code: int, error: BaseException | str) -> int:
    print("indenter:", _plain(" ".join(str(error).split())), file=sys.stderr)
    return code


def _plain(text: str) -> str:
    """Return text that may come from a stranger's file without what a terminal would obey."""
    return "".join(character if character.isprintable() else "\ufffd" for character in text)


def _demo(given: argparse.Namespace) -> None:
    from rig.commands.demo import run_demo

    print(run_demo(given.out))


def _run(given: argparse.Namespace) -> None:
    from rig.commands.run import run_protocol_file, write_examples
    from rig.hardware.processes import ask_for_priority

    if given.example is not None:
        write_examples(given.example)
        print(f"examples written to {given.example}")
        return
    if given.protocol is None:
        raise BadInputError("indenter run: no protocol file: give one, or --example DIR to get some")
    out = given.out or Path(given.protocol.stem)
    ask_for_priority()
    print(run_protocol_file(given.protocol, rig=given.rig, out=out, accept=given.accept))


def _calibrate(given: argparse.Namespace) -> None:
    from rig.commands.calibrate import calibrate

    print(calibrate(given.which, rig=given.rig, out=given.out))


def _safe(given: argparse.Namespace) -> None:
    from rig.commands.safe import make_safe

    done = make_safe(given.rig)
    print(f"the arm is clear: moved from {done.from_mm:.2f} to {done.to_mm:.2f} mm")


def _import(given: argparse.Namespace) -> int:
    from analysis.recordings.importers.instructions import Instructions, read_mapping, said_on_command_line
    from rig.commands.importing import import_and_show

    said = said_on_command_line(
        given.column,
        given.unit,
        given.sheet,
        finger=given.finger,
        depth_mm=given.depth,
        ramp_speed_mm_s=given.speed,
        punch_diameter_mm=given.punch,
    )
    mapped = read_mapping(given.mapping) if given.mapping is not None else Instructions()
    made = import_and_show(given.files, given.out, kind=given.kind, said=mapped.over(said), plot=given.plot)
    return EXIT_OK if made else EXIT_BAD_INPUT


def _fit(given: argparse.Namespace) -> None:
    from analysis.relaxation.batch import fit_paths
    from analysis.relaxation.screen import show_fits

    page = fit_paths(
        given.paths,
        model=given.model,
        out=given.out,
        jobs=given.jobs,
        dask=given.dask,
        intervals=given.intervals,
        joint=given.joint,
        exponent=given.exponent,
        show=show_fits,
    )
    print(page)


def _export(given: argparse.Namespace) -> None:
    from analysis.export.exporting import export_trials

    done = export_trials(given.paths, given.to, given.out)
    for path in done.written:
        print(path)
    for _, reason in done.left_out:
        print("indenter: left out:", " ".join(reason.split()), file=sys.stderr)


def _diagnose(given: argparse.Namespace) -> None:
    from analysis.mismatch.diagnose import diagnose_paths
    from analysis.mismatch.report.screen import show_report

    page = diagnose_paths(
        given.paths,
        baseline=given.baseline,
        out=given.out,
        seed=given.seed,
        tolerance_mn=given.tolerance,
        show=show_report,
    )
    print(page)


def _prove(given: argparse.Namespace) -> None:
    from rig.proof.proving import run_proof

    print(run_proof(cases=given.cases, seed=given.seed, out=given.out))


def _rescue(given: argparse.Namespace) -> int:
    from analysis.recordings.live.rescue import rescue_paths

    outcomes = rescue_paths(given.paths)
    for outcome in outcomes:
        unreadable = outcome.result == "unreadable"
        print(_plain(f"{outcome.path}: {outcome.action}"), file=sys.stderr if unreadable else sys.stdout)
    return EXIT_BAD_INPUT if all(outcome.result == "unreadable" for outcome in outcomes) else EXIT_OK


def _discard(given: argparse.Namespace) -> None:
    from analysis.recordings import mark_discarded

    for path in given.files:
        mark_discarded(path, given.reason)
        print(f"{path}: discarded ({given.reason})")


def _fingertip(given: argparse.Namespace) -> None:
    from analysis.fingertip import commands

    if given.what == "example":
        print(commands.write_example(given.folder))
    elif given.what == "compare":
        motion = {"depth_mm": given.depth, "speed_mm_s": given.speed, "hold_s": given.hold}
        print(commands.compare_surface(given.surface, out=given.out, cache=given.cache, **motion))
    elif given.what == "receptor":
        depths = {"shallowest_mm": given.shallowest, "deepest_mm": given.deepest}
        print(commands.predict_receptor(out=given.out, rates=given.rates, cache=given.cache, **depths))
    else:
        print(
            commands.calibrate_pads(
                given.fits, pad=given.pad, out=given.out, finger=given.finger, cache=given.cache
            )
        )


def _watch(_: argparse.Namespace) -> None:
    from rig.commands.watch import watch

    watch()


def _gui(given: argparse.Namespace) -> int:
    from rig.gui.app import open_window

    return open_window(given.rig)


_COMMANDS: dict[str, Callable[[argparse.Namespace], int | None]] = {
    "demo": _demo,
    "run": _run,
    "calibrate": _calibrate,
    "safe": _safe,
    "import": _import,
    "fit": _fit,
    "export": _export,
    "diagnose": _diagnose,
    "prove": _prove,
    "rescue": _rescue,
    "discard": _discard,
    "fingertip": _fingertip,
    "watch": _watch,
    "gui": _gui,
}


def _parser() -> argparse.ArgumentParser:
    parser = _OneLineParser(
        prog="indenter",
        description="Runs a finger-pad indentation rig, fits the relaxation, names what a simulation omits.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="say which version this is")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_bench_commands(commands)
    _add_analysis_commands(commands)
    _add_fingertip_commands(commands)
    return parser


def _add_bench_commands(commands: argparse._SubParsersAction[_OneLineParser]) -> None:
    rig_help = "the rig file; without it, the simulated rig"

    demo = commands.add_parser(
        "demo", help="the main job on the simulated rig: calibrate, run a study, fit, diagnose, report"
    )
    demo.add_argument("--out", type=Path, default=Path("indenter-demo"), metavar="DIR")

    run = commands.add_parser("run", help="run a protocol or a study, or go on with one")
    run.add_argument("protocol", type=Path, nargs="?", metavar="PROTOCOL.toml")
    run.add_argument("--rig", type=Path, metavar="RIG.toml", help=rig_help)
    run.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of the trials; default: the protocol's name"
    )
    run.add_argument(
        "--example", type=Path, metavar="DIR", help="write rig and protocol files, every key explained"
    )

    run.add_argument(
        "--accept",
        action="store_true",
        help="go on with a calibration that has expired, or that differs from the study's",
    )

    calibrate = commands.add_parser("calibrate", help="measure the constants of position or force")
    calibrate.add_argument("which", choices=("position", "force"))
    calibrate.add_argument("--rig", type=Path, metavar="RIG.toml", help=rig_help)
    calibrate.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of calibrations; default: the one the rig file names"
    )

    safe = commands.add_parser("safe", help="take the card of a run that died and clear the arm")
    safe.add_argument("--rig", type=Path, metavar="RIG.toml", help=rig_help)

    discard = commands.add_parser("discard", help="mark trials as no good; their files stay")
    discard.add_argument("files", type=Path, nargs="+", metavar="FILE")
    discard.add_argument("--reason", required=True, metavar="TEXT")

    rescue = commands.add_parser("rescue", help="bring back trials whose run was cut off")
    rescue.add_argument("paths", type=Path, nargs="+", metavar="FILE|DIR")

    commands.add_parser("watch", help="follow the run in progress: state, time left, position and force")

    gui = commands.add_parser("gui", help="the bench window: live signals, study, calibration, trials")
    gui.add_argument(
        "--rig", type=Path, metavar="RIG.toml", help="the rig file; without it, the last one used"
    )

    prove = commands.add_parser("prove", help="conceal effects in the simulated rig, diagnose blind, score")
    prove.add_argument("--cases", type=_at_least(1), default=12, metavar="N")
    prove.add_argument("--seed", type=_at_least(0), default=0, metavar="S")
    prove.add_argument("--out", type=Path, default=Path("proof"), metavar="DIR")


def _add_analysis_commands(commands: argparse._SubParsersAction[_OneLineParser]) -> None:
    from analysis.recordings.trial import FINGERS, Kind

    importing = commands.add_parser(
        "import",
        help="turn .ddf, .csv, .xlsx and AFM files into trial files",
        description=_IMPORT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    importing.add_argument("files", type=Path, nargs="+", metavar="FILE|DIR")
    importing.add_argument("--out", type=Path, required=True, metavar="DIR")
    importing.add_argument(
        "--kind", choices=get_args(Kind), metavar="KIND", help=f"what was done: {', '.join(get_args(Kind))}"
    )
    importing.add_argument(
        "--column", action="append", default=[], metavar="QUANTITY=NAME", help="which column is which"
    )
    importing.add_argument(
        "--unit", action="append", default=[], metavar="QUANTITY=UNIT", help="a unit; -N turns the sign"
    )
    importing.add_argument("--sheet", metavar="NAME", help="of a spreadsheet that has several")
    importing.add_argument("--mapping", type=Path, metavar="FILE.toml", help="all of this for a folder")
    importing.add_argument("--finger", choices=FINGERS, metavar="FINGER", help=", ".join(FINGERS))
    importing.add_argument("--depth", type=_positive, metavar="MM", help="depth of the protocol")
    importing.add_argument("--speed", type=_positive, metavar="MM/S", help="speed of its ramp")
    importing.add_argument("--punch", type=_positive, metavar="MM", help="diameter of the punch")
    importing.add_argument("--plot", action="store_true", help="a picture of each trial with its phases")

    fit = commands.add_parser("fit", help="fit the relaxation of every trial: tables, figures, a page")
    fit.add_argument("paths", type=Path, nargs="+", metavar="FILE|DIR")
    fit.add_argument("--model", choices=("ramp", "step"), default="ramp")
    fit.add_argument(
        "--exponent",
        type=_positive,
        metavar="P",
        help="force grows as depth to this power (1 flat punch, 1.5 sphere, 2 cone); default: as loading shows",
    )
    fit.add_argument("--out", type=Path, default=Path("fits"), metavar="DIR")
    fit.add_argument("--jobs", type=_at_least(1), metavar="N", help="processes at a time")
    fit.add_argument("--intervals", action="store_true", help="profile intervals of every trial as well")
    fit.add_argument("--joint", action="store_true", help="one solid for all trials of a finger as well")
    fit.add_argument("--dask", metavar="ADDRESS", help="send the trials to this Dask scheduler")

    export = commands.add_parser("export", help="trials and fits for other programs: CSV, NWB, Parquet")
    export.add_argument("paths", type=Path, nargs="+", metavar="FILE|DIR")
    export.add_argument("--to", required=True, choices=("csv", "nwb", "parquet"))
    export.add_argument("--out", type=Path, required=True, metavar="OUT", help="folder of what is written")

    diagnose = commands.add_parser(
        "diagnose", help="compare simulation and recordings; name what was left out"
    )
    diagnose.add_argument("paths", type=Path, nargs="+", metavar="FILE|DIR")
    diagnose.add_argument("--baseline", choices=("ramp", "step"), default="ramp")
    diagnose.add_argument("--out", type=Path, default=Path("diagnosis"), metavar="DIR")
    diagnose.add_argument("--seed", type=_at_least(0), default=0, metavar="N")
    diagnose.add_argument(
        "--tolerance",
        type=_positive,
        default=0.3,
        metavar="MN",
        help="a remainder below this, and below a tenth of the mismatch, is small; mN rms",
    )


def _add_fingertip_commands(commands: argparse._SubParsersAction[_OneLineParser]) -> None:
    fingertip = commands.add_parser("fingertip", help="the finite-element finger pad")
    parts = fingertip.add_subparsers(dest="what", required=True, metavar="PART")

    example = parts.add_parser("example", help="write a pad.toml with every size and its source")
    example.add_argument("folder", type=Path, metavar="DIR")

    calibrate = parts.add_parser(
        "calibrate", help="moduli and Prony terms of the pad, from measured relaxation"
    )
    calibrate.add_argument("fits", type=Path, metavar="FITS", help="fits.json or fits.csv of `indenter fit`")
    calibrate.add_argument("--pad", type=Path, metavar="pad.toml", help="without it, the pad that ships")
    calibrate.add_argument("--finger", help="only the trials of this finger")
    _add_pad_folders(calibrate)

    compare = parts.add_parser(
        "compare", help="a measured surface beside the calibrated pads: which ratio fits"
    )
    compare.add_argument("surface", type=Path, metavar="SURFACE.csv", help="position_mm, deflection_mm")
    compare.add_argument("--depth", type=_positive, default=0.5, metavar="MM", help="of the line")
    compare.add_argument("--speed", type=_positive, default=0.5, metavar="MM_S", help="of the line")
    compare.add_argument(
        "--hold", type=_positive, default=3.0, metavar="S", help="until the surface was measured"
    )
    _add_pad_folders(compare)

    receptor = parts.add_parser("receptor", help="strain energy at a receptor under a plate, over time")
    receptor.add_argument("--rates", type=Path, metavar="RATES.csv", help="time_s, rate_hz of a receptor")
    receptor.add_argument("--shallowest", type=_positive, default=0.4, metavar="MM")
    receptor.add_argument("--deepest", type=_positive, default=1.0, metavar="MM")
    _add_pad_folders(receptor)


def _add_pad_folders(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, default=Path("fingertip"), metavar="OUT")
    parser.add_argument(
        "--cache", type=Path, metavar="DIR", help="folder of solved pads; default: the user's cache"
    )


def _at_least(least: int) -> Callable[[str], int]:
    def whole_number(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"{text} is below {least}")
        return value

    return whole_number


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


if __name__ == "__main__":
    sys.exit(main())
