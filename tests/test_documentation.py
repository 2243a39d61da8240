"""The documentation: its code runs as it stands, its links lead somewhere, and its list of names is complete."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import stickslip

ROOT = Path(__file__).parents[1]
DOCS = sorted((ROOT / "docs").glob("*.md"))
PAGES = [ROOT / "README.md", *DOCS]
TEXTS = {path: path.read_text(encoding="utf-8") for path in [*PAGES, ROOT / "CHANGELOG.md"]}
API = TEXTS[ROOT / "docs" / "api.md"]

# other tests run architecture.md in a copy of the package, and index.md and README.md in processes of their own
ELSEWHERE = {"architecture.md", "index.md", "README.md"}
SNIPPETS = {
    f"{path.stem}-{k}": code
    for path in PAGES
    if path.name not in ELSEWHERE
    for k, code in enumerate(re.findall(r"^```python\n(.*?)^```", TEXTS[path], re.MULTILINE | re.DOTALL), 1)
}


def name_of(path: Path) -> str:
    return path.name


def resolved(name: str) -> object:
    """What a dotted name stands for."""
    parts = name.split(".")
    thing: object = importlib.import_module(parts[0])
    for k, part in enumerate(parts[1:], start=2):
        if not hasattr(thing, part):
            importlib.import_module(".".join(parts[:k]))
        thing = getattr(thing, part)
    return thing


def test_there_are_snippets() -> None:
    assert {"accuracy-1", "cycles-1", "events-1", "how_do_i-20"} <= SNIPPETS.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", SNIPPETS)
def test_a_snippet_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(SNIPPETS[name], name, "exec"), {"__name__": "__main__"})


@pytest.mark.slow
def test_the_readme_prints_what_it_says(tmp_path: Path) -> None:
    text = TEXTS[ROOT / "README.md"]
    code, told = re.findall(r"^```python\n(.*?)^```\n\n```text\n(.*?)^```", text, re.MULTILINE | re.DOTALL)[0]
    environment = os.environ | {"MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == told, done.stderr


def test_every_public_name_is_in_the_api() -> None:
    for name in stickslip.__all__:
        assert re.search(rf"\bstickslip\.{name}\b(?!\.)", API), name


@pytest.mark.parametrize("name", re.findall(r"^::: (\S+)$", API, flags=re.MULTILINE))
def test_names_of_the_api_exist(name: str) -> None:
    assert resolved(name) is not None


@pytest.mark.parametrize("path", TEXTS, ids=name_of)
def test_links_lead_somewhere(path: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", TEXTS[path]):
        if target.startswith("http"):
            continue
        file, _, anchor = target.partition("#")
        page = path.parent / file if file else path
        assert page.exists(), target
        if anchor:
            titles = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
            anchors = {re.sub(r"[^\w\s-]", "", title).strip().lower().replace(" ", "-") for title in titles}
            assert anchor in anchors, target


def test_every_page_is_in_the_menu() -> None:
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for path in DOCS:
        assert f": {path.name}\n" in menu, path.name


def test_modules_that_pages_run_exist() -> None:
    for path, text in TEXTS.items():
        for module in re.findall(r"python3? -m ((?:benchmarks|validation|stickslip)[\w.]*)", text):
            file = ROOT.joinpath(*module.split("."))
            assert file.with_suffix(".py").exists() or (file / "__main__.py").exists(), f"{path.name}: {module}"
