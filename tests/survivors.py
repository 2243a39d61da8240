"""Whether the tests notice that the package is wrong: ``python tests/survivors.py 20`` tries 20 small changes of it.

They are drawn from the syntax tree. Each is made in a scratch copy, against the tests that run the changed lines. A
change that survives is a hole in the tests, or harmless.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from fnmatch import fnmatchcase
from pathlib import Path

from source_changes import Change, changes_of, sample

PACKAGE = "stickslip"
ROOT = Path(__file__).resolve().parents[1]
_NOT_COPIED = (
    ".git",
    ".venv",
    "__pycache__",
    ".*_cache",
    ".hypothesis",
    "site",
    "build",
    "dist",
    "*.egg-info",
)
_SLOWER = 4.0
"""A change that makes its tests take this many times as long, and a bit, never ends: that is noticed."""
_STARTUP = 20.0
_NO_TESTS = 5
"""Exit code of pytest."""


class Fate(StrEnum):
    """What became of a change."""

    NOTICED = "noticed"
    ENDLESS = "does not end"
    SURVIVED = "SURVIVES"
    UNTESTED = "SURVIVES: no test runs it"


@dataclass(frozen=True)
class Trial:
    """A change and what became of it.

    Attributes
    ----------
    change : Change
    fate : Fate
    tests : int
        How many tests were to notice.
    by : str
        The test that noticed.
    """

    change: Change
    fate: Fate
    tests: int
    by: str = ""

    @property
    def survived(self) -> bool:
        """Whether no test noticed."""
        return self.fate in (Fate.SURVIVED, Fate.UNTESTED)

    def __str__(self) -> str:
        return f"{self.fate:12s} {self.change}  ({self.by or f'{self.tests} tests'})"


@dataclass(frozen=True)
class Record:
    """How long each test takes on the sound package, and which lines it runs."""

    seconds: dict[str, float]
    run: dict[str, dict[str, frozenset[int]]]

    def tests_for(self, change: Change, limit: float) -> list[str]:
        """Return the tests that run the changed lines, the quickest first, as many as fit into `limit` seconds.

        Code outside of functions runs on import: all tests that run lines of the same file are taken. For code that
        only other processes run, all tests are taken, those first that name the file.
        """
        chosen = [name for name, run in self.run.items() if not change.lines.isdisjoint(run.get(change.file, ()))]
        if not chosen:
            chosen = [name for name, run in self.run.items() if change.file in run]
        stem = Path(change.file).stem.strip("_")
        far = {name: bool(chosen) or stem not in name for name in self.seconds}
        order = sorted(chosen or self.seconds, key=lambda name: (far[name], self.seconds[name]))
        taken, spent = [], 0.0
        for name in order:
            spent += self.seconds[name]
            if taken and spent > limit:
                break
            taken.append(name)
        return taken


@contextmanager
def scratch_copy(root: Path = ROOT) -> Iterator[Path]:
    """Give a copy of the project that may be changed, and remove it afterwards."""
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        copy = Path(folder) / "project"
        shutil.copytree(root, copy, ignore=shutil.ignore_patterns(*_NOT_COPIED))
        yield copy


def record(copy: Path, tests: Sequence[str], keep: Path | None = None) -> Record:
    """Run the tests on the sound package, and note what each runs; read it from `keep` if nothing has changed.

    Parameters
    ----------
    copy : Path
        A scratch copy.
    tests : sequence of str
        What pytest is to run: files and options.
    keep : Path, optional
        Where to keep what was noted.
    """
    files = sorted(path for part in (PACKAGE, "tests") for path in (copy / part).rglob("*.py"))
    state = hashlib.sha256("\0".join(tests).encode())
    for path in files:
        state.update(path.relative_to(copy).as_posix().encode() + b"\0" + path.read_bytes())
    if keep is not None and keep.exists():
        kept = json.loads(keep.read_text())
        if kept["state"] == state.hexdigest():
            return _record_of(kept["tests"])
    notes = copy / "record.json"
    _pytest(copy, tests, {"STICKSLIP_RECORD": str(notes), "STICKSLIP_PACKAGE": str(copy / PACKAGE)}, None)
    noted = json.loads(notes.read_text())
    if keep is not None:
        keep.write_text(json.dumps({"state": state.hexdigest(), "tests": noted}))
    return _record_of(noted)


def _record_of(noted: dict[str, dict[str, object]]) -> Record:
    sound = {name: test for name, test in noted.items() if "failed" not in test}
    seconds = {name: float(test["seconds"]) for name, test in sound.items()}  # type: ignore[arg-type]
    run = {
        name: {file: frozenset(lines) for file, lines in test["run"].items()}  # type: ignore[attr-defined]
        for name, test in sound.items()
    }
    return Record(seconds, run)


def try_change(copy: Path, change: Change, known: Record, limit: float) -> Trial:
    """Change the scratch copy, run the tests concerned until one fails, and mend it again.

    Parameters
    ----------
    copy : Path
        A scratch copy.
    change : Change
    known : Record
    limit : float
        How long in s the tests may take on the sound package.
    """
    chosen = known.tests_for(change, limit)
    if not chosen:
        return Trial(change, Fate.UNTESTED, 0)
    path, listed = copy / change.file, copy / "tests-to-run.txt"
    sound, stamp = path.read_bytes(), path.stat()
    listed.write_text("\n".join(chosen))
    patience = _STARTUP + _SLOWER * sum(known.seconds[name] for name in chosen)
    files = sorted({name.partition("::")[0] for name in chosen})
    try:
        path.write_bytes(change.applied(sound))
        # another time, lest the compiled sound file be taken for it
        os.utime(path, (stamp.st_atime, stamp.st_mtime + 10.0))
        code, said = _pytest(copy, ["-x", *files], {"STICKSLIP_TESTS": str(listed)}, patience)
    finally:
        path.write_bytes(sound)
        os.utime(path, (stamp.st_atime, stamp.st_mtime))
    if code is None:
        return Trial(change, Fate.ENDLESS, len(chosen), f"after {patience:.0f} s")
    if code == _NO_TESTS:
        raise RuntimeError(f"pytest finds none of the tests of {change}:\n{said}")
    if code == 0:
        return Trial(change, Fate.SURVIVED, len(chosen))
    failed = [line.split()[1] for line in said.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    return Trial(change, Fate.NOTICED, len(chosen), failed[0] if failed else f"pytest ends with {code}")


def _pytest(
    copy: Path, arguments: Sequence[str], settings: dict[str, str], patience: float | None
) -> tuple[int | None, str]:
    """Run pytest in a scratch copy; return its exit code, None if it did not end in time, and what it said."""
    settings = {
        "PYTHONPATH": os.pathsep.join([str(copy), str(copy / "tests")]),
        "MPLBACKEND": "Agg",
        "OMP_NUM_THREADS": "1",
    } | settings
    if patience is not None:
        settings["PYTHONDONTWRITEBYTECODE"] = "1"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "recording", "-p", "no:cacheprovider"]
    command += ["--hypothesis-seed=0", *arguments]
    # a session of its own: what tests have started ends with them
    process = subprocess.Popen(
        command,
        cwd=copy,
        env={k: v for k, v in os.environ.items() if not k.startswith("STICKSLIP_")} | settings,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        said, _ = process.communicate(timeout=patience)
    except subprocess.TimeoutExpired:
        _end(process)
        return None, ""
    except BaseException:
        _end(process)
        raise
    return process.returncode, said


def _end(process: subprocess.Popen[str]) -> None:
    if os.name == "posix":
        import signal

        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.communicate()


def main(arguments: Sequence[str] | None = None) -> int:
    """Try generated changes, one after another; return 1 if one survives."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("number", type=int, help="how many changes to try")
    parser.add_argument("--seed", type=int, default=0, help="which changes to make (default 0)")
    parser.add_argument("--only", default="*", metavar="PATTERN", help="files to change, such as '*/plots*'")
    parser.add_argument(
        "--limit", type=float, default=30.0, help="seconds that the tests of one change may take (default 30)"
    )
    parser.add_argument("--slow", action="store_true", help="let slow tests watch too")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="keep here which test runs what, and read it")
    options = parser.parse_args(arguments)
    tests = ["tests"] if options.slow else ["tests", "-m", "not slow"]
    trials: list[Trial] = []
    with scratch_copy() as copy:
        changes = [change for change in changes_of(copy / PACKAGE) if fnmatchcase(change.file, options.only)]
        known = record(copy, tests, options.keep)
        for change in sample(changes, options.number, options.seed, copy):
            trials.append(try_change(copy, change, known, options.limit))
            print(trials[-1], flush=True)
    survivors = [trial for trial in trials if trial.survived]
    print(f"\n{len(trials)} changes: {len(trials) - len(survivors)} noticed, {len(survivors)} survive")
    for trial in survivors:
        print(f"  {trial.change}")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
