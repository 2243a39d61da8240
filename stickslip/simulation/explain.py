"""`explain`: what a scene is compiled to and which engine takes it, or what happened in a result."""

from __future__ import annotations

from stickslip.engines import METHODS
from stickslip.model.scene import Scene
from stickslip.results.explanations import explain_result, explain_scene, span_of
from stickslip.simulation.arguments import Times, span
from stickslip.simulation.choice import choose
from stickslip.simulation.result import Result
from stickslip.simulation.simulate import compiled


def explain(subject: Scene | Result, t_span: Times | None = None) -> str:
    """Return in words what a scene is compiled to, and which engine takes it; of a result also why each event happened.

    Parameters
    ----------
    subject : Scene or Result
    t_span : (float, float), optional
        Time span in s for the stop times of a scene; by default from 0 to past the last break of a load.

    Raises
    ------
    TypeError
        If `subject` is neither a scene nor a result.
    ValueError
        If a result is given together with a time span, or the span does not run forward.
    """
    if isinstance(subject, Result):
        if t_span is not None:
            raise ValueError("explain: a result has a time span of its own; leave t_span out")
        return explain_result(subject)
    if not isinstance(subject, Scene):
        raise TypeError(f"explain: expected a Scene or a Result, got {type(subject).__name__}")
    start, stop = span_of(subject) if t_span is None else span(t_span, "explain")
    system = compiled(subject)
    loads = system.loads(start, stop)
    name, reason = choose(system, loads, "contact-force", "auto", stop - start)
    return explain_scene(system, loads, METHODS[name].title, reason)
