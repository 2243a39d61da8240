"""The examples of docs/architecture.md, applied to a copy of the package and run there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import stickslip

PACKAGE = Path(stickslip.__file__).parent
ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^### (.+?)\n(.*?)(?=^##|\Z)", PAGE, flags=re.MULTILINE | re.DOTALL))


def blocks(section: str) -> list[tuple[str, str]]:
    """The language and the text of each block of code."""
    return re.findall(r"^```(\w+)\n(.*?)^```", SECTIONS[section], flags=re.MULTILINE | re.DOTALL)


def change(file: Path, hunks: str) -> None:
    """Change lines of a file: those kept begin with a blank, old ones with a minus, new ones with a plus."""
    text = file.read_text(encoding="utf-8")
    for hunk in hunks.split("---\n"):
        lines = hunk.splitlines(keepends=True)
        before = "".join(line[1:] for line in lines if line[0] in " -")
        after = "".join(line[1:] for line in lines if line[0] in " +")
        assert text.count(before) == 1, f"{file.name} has {before!r} {text.count(before)} times"
        text = text.replace(before, after)
    file.write_text(text, encoding="utf-8")


def applied(section: str, folder: Path) -> str:
    """Write and change the files of a section below a folder; return the code that uses them."""
    use = ""
    for language, text in blocks(section):
        first, rest = text.split("\n", 1)
        if language == "diff":
            change(folder / first.removeprefix("--- "), rest)
        elif first.startswith("# new file "):
            file = folder / first.removeprefix("# new file ")
            assert not file.exists()
            file.write_text(rest, encoding="utf-8")
        else:
            use += text
    return use


def run(folder: Path, *arguments: str) -> None:
    environment = os.environ | {"PYTHONPATH": str(folder), "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    shutil.copytree(PACKAGE, tmp_path / "stickslip", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_there_is_an_example_of_every_kind() -> None:
    assert list(SECTIONS) == ["A law", "An element", "An engine", "A plot", "A study"]


@pytest.mark.slow
@pytest.mark.parametrize("section", SECTIONS)
def test_example_runs(section: str, copy: Path) -> None:
    use = applied(section, copy)
    assert "assert" in use
    run(copy, "-c", "import stickslip\nassert stickslip.__file__.startswith(r'" + str(copy) + "')\n" + use)


@pytest.mark.slow
def test_all_examples_keep_to_the_rooms(copy: Path) -> None:
    for section in SECTIONS:
        applied(section, copy)
    rules = shutil.copy(ROOT / "tests" / "test_architecture.py", copy)
    run(copy, "-m", "pytest", "-q", "--assert=plain", "-p", "no:cacheprovider", str(rules))


def test_every_file_of_the_package_is_in_the_tree() -> None:
    (tree,) = re.findall(r"^```text\n(stickslip/\n.*?)^```", PAGE, flags=re.MULTILINE | re.DOTALL)
    rooms = {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert set(re.findall(r"^  (\w+)/", tree, flags=re.MULTILINE)) == rooms
    named = set(re.findall(r"(\w+\.py)", tree))
    for room in ("model", "equations", "events", "engines", "results", "simulation"):
        for path in (PACKAGE / room).rglob("*.py"):
            assert path.name in named or path.name == "__init__.py", f"{path.name} is not in the tree"
    files = {path.name for path in PACKAGE.rglob("*.py")}
    assert named <= files


def test_functions_that_the_walk_names_exist() -> None:
    walk = PAGE[PAGE.index("## One force") : PAGE.index("## Adding something")]
    source = "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    for path in re.findall(r"`((?:\w+/)+\w+\.py)`", walk):
        assert (PACKAGE / path).exists(), path
    for name in re.findall(r"`(?:\w+\.)?(\w+)`", walk):
        assert re.search(rf"\b{name}\b", source), name
