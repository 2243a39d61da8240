"""Arguments of all that is public get values of every wrong kind: each is refused, and in our own words."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from calls import CALLS, LEAKED, RESULT, STRANGE, Call

import stickslip
from stickslip import plots

MAY_FIT = {"odd number", "empty"}
"""What some arguments take and others do not."""

CALLABLE = {"function", "result"}
"""A result can be called, too."""


def kinds(value: Any) -> set[str]:
    """Return the kinds of values that fit an argument for which this value is valid."""
    if isinstance(value, list | tuple):
        first = value[0] if value else 0.0
        return {"texts"} if isinstance(first, str) else {"numbers"} if isinstance(first, float) else {"matrix"}
    for kind, some in STRANGE.items():
        if type(value) in {type(one) for one in some if type(one) is not object}:
            return CALLABLE if kind == "function" else {kind}
    return {"load"} if isinstance(value, stickslip.Quantity) else CALLABLE


def said(call: Call, name: str, value: Any) -> str | None:
    """Return the message of a refusal, without the value that it quotes; None where there is none."""
    try:
        call.made(**call.given | {name: value})
    except (ValueError, TypeError) as error:
        return re.sub(r"got .*", "got", str(error), flags=re.DOTALL)
    except OSError:  # a file that cannot be written, or is not there
        return "no such file"
    return None


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("kept") / "kept.npz"
    RESULT.save(path)
    return path.read_bytes()


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(kept: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kept.npz").write_bytes(kept)


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.name)
def test_values_of_a_wrong_kind_are_refused_in_our_words(call: Call) -> None:
    for name, good in call.given.items():
        taken = kinds(good) | call.also.get(name, set())
        for kind, values in STRANGE.items():
            if call.draws and kind in taken | MAY_FIT:
                continue  # a figure takes its time
            for value in values:
                message = said(call, name, value)
                if message is None:
                    assert kind in taken | MAY_FIT, f"{call.name} takes {name}={value!r}"
                else:
                    assert not LEAKED.search(message), f"{call.name}, {name}={value!r}: {message}"
                    assert len(message) > 10, f"{call.name}, {name}={value!r}: {message}"


def test_all_that_is_public_is_called() -> None:
    called = [call.made for call in CALLS]
    # studies have tests of their own; results are not made by users
    studies = {"continue_cycle", "fit", "limit_cycle", "linearize", "sensitivities", "sweep", "tradeoff"}
    studies |= {"work_precision", "sweep_map", "bifurcation"}
    others = {"feedback", "Scene", "output", "Mode", "Quantity", "Signal", "Event", "Figure"}
    returned = {"Branch", "Cycle", "Fit", "Joined", "LinearModel", "Result", "Sensitivities"}
    for module in (stickslip, plots):
        for name in module.__all__:
            thing = getattr(module, name)
            is_error = isinstance(thing, type) and issubclass(thing, BaseException)
            if callable(thing) and not is_error and name not in studies | others | returned:
                assert thing in called, name
