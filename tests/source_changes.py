"""Changes to the package made from its syntax tree: signs, sides, comparisons, numbers, terms, keywords, branches.

Each is one edit of one expression or statement. Where the source lies does not matter: every file below the folder of
the package is read. What text says (docstrings, messages, f-strings, annotations, `__all__`) is left alone.
"""

from __future__ import annotations

import ast
import random
from collections import defaultdict
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

__all__ = ["KINDS", "Change", "changes_of", "sample"]

_PAIRS = (
    "a b, min max, minimum maximum, argmin argmax, upper lower, left right, low high, before after, start stop, "
    "first last, floor ceil, any all, forward backward, FORWARD BACKWARD, mu_s mu_c, mu_static mu_coulomb, sin cos, "
    "ones zeros, ones_like zeros_like, bisect_left bisect_right"
)
_OTHER = {x: y for pair in _PAIRS.split(", ") for x, y in (pair.split(), pair.split()[::-1])}
_COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.GtE),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_WRAPPERS = {"abs", "maximum", "minimum", "max", "min", "clip", "sign", "copy", "unique", "sorted"}


@dataclass(frozen=True)
class Change:
    """One edit of one file.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    file : str
        Path from the folder that holds the package.
    line : int
    lines : frozenset of int
        The lines it stands on; none outside of functions.
    before, after : str
        What stood there and what stands there instead.
    span : (int, int)
        Where it stood, in bytes.
    """

    kind: str
    file: str
    line: int
    lines: frozenset[int]
    before: str
    after: str
    span: tuple[int, int]

    def applied(self, source: bytes) -> bytes:
        """Return the changed source."""
        first, last = self.span
        return source[:first] + self.after.encode() + source[last:]

    def __str__(self) -> str:
        return f"{self.file}:{self.line}  [{self.kind}]  {_one_line(self.before)}  ->  {_one_line(self.after)}"


Edit = tuple[ast.AST, ast.AST]
"""What is replaced, and by what."""


def _signs(node: ast.AST) -> Iterator[Edit]:
    """Plus for minus and the other way round."""
    turned: dict[type[ast.operator], type[ast.operator]] = {
        ast.Add: ast.Sub,
        ast.Sub: ast.Add,
        ast.Mult: ast.Div,
        ast.Div: ast.Mult,
    }
    if isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in turned and not _is_text(node):
        changed = deepcopy(node)
        changed.op = turned[type(node.op)]()
        yield node, changed
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield node, node.operand


def _sides(node: ast.AST) -> Iterator[Edit]:
    """A name for its counterpart, and the first of two for the second."""
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in ("min", "max", "any", "all"):
        yield node, ast.Name(_OTHER[node.id], ast.Load())
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load) and node.attr in _OTHER:
        yield node, ast.Attribute(node.value, _OTHER[node.attr], ast.Load())
    elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in ("left", "right"):
        yield node, ast.Constant(_OTHER[node.value])
    elif isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Load):
        place = node.slice
        if isinstance(place, ast.Constant) and place.value in (0, 1) and place.value is not True:
            yield node, ast.Subscript(node.value, ast.Constant(1 - place.value), ast.Load())
        elif isinstance(place, ast.UnaryOp) and isinstance(place.operand, ast.Constant):
            yield node, ast.Subscript(node.value, ast.Constant(0), ast.Load())


def _comparisons(node: ast.AST) -> Iterator[Edit]:
    """< for <=, and the other way round."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        for other in _COMPARED.get(type(node.ops[0]), ()):
            yield node, ast.Compare(node.left, [other()], node.comparators)
    elif isinstance(node, ast.Compare):
        for place, op in enumerate(node.ops):
            for other in _COMPARED.get(type(op), ())[:1]:
                ops = [other() if k == place else kept for k, kept in enumerate(node.ops)]
                yield node, ast.Compare(node.left, ops, node.comparators)


def _numbers(node: ast.AST) -> Iterator[Edit]:
    """Whole numbers that are one too large or too small; others that are twice as large."""
    if isinstance(node, ast.Constant) and type(node.value) is int:
        yield node, ast.Constant(node.value + 1)
        if node.value > 1:
            yield node, ast.Constant(node.value - 1)
    elif isinstance(node, ast.Constant) and type(node.value) is float:
        yield node, ast.Constant(2 * node.value if node.value else 1.0)


def _terms(node: ast.AST) -> Iterator[Edit]:
    """A sum without one of its terms, a product without one of its factors."""
    if isinstance(node, ast.BinOp) and not _is_text(node):
        if isinstance(node.op, (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.BitAnd, ast.BitOr)):
            yield node, node.left
        if isinstance(node.op, (ast.Add, ast.Mult, ast.BitAnd, ast.BitOr)):
            yield node, node.right
        elif isinstance(node.op, ast.Sub):
            yield node, ast.UnaryOp(ast.USub(), node.right)
    elif isinstance(node, ast.BoolOp):
        for place in range(len(node.values)):
            rest = [value for k, value in enumerate(node.values) if k != place]
            yield node, rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.Invert)):
        yield node, node.operand


def _keywords(node: ast.AST) -> Iterator[Edit]:
    """A call without one of its keyword arguments."""
    if isinstance(node, ast.Call):
        for place, keyword in enumerate(node.keywords):
            if keyword.arg is not None:
                rest = [kept for k, kept in enumerate(node.keywords) if k != place]
                yield node, ast.Call(node.func, node.args, rest)


def _branches(node: ast.AST) -> Iterator[Edit]:
    """One branch for the other."""
    if isinstance(node, ast.IfExp):
        yield node, ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, (ast.If, ast.While)):
        yield node.test, ast.UnaryOp(ast.Not(), node.test)
        if isinstance(node, ast.If):
            yield node.test, ast.BoolOp(ast.And(), [ast.Constant(False), node.test])
    elif isinstance(node, ast.BoolOp):
        yield node, ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif isinstance(node, ast.Call) and _name(node.func) == "where" and len(node.args) == 3:
        test, yes, no = node.args
        yield node, ast.Call(node.func, [test, no, yes], node.keywords)


def _calls(node: ast.AST) -> Iterator[Edit]:
    """What a function that limits, orders or copies is given, for what it returns; a statement left out."""
    if isinstance(node, ast.Call) and _name(node.func) in _WRAPPERS and not node.keywords:
        if len(node.args) in (1, 2) and not any(isinstance(arg, (ast.Starred, ast.GeneratorExp)) for arg in node.args):
            yield node, node.args[0]
        elif not node.args and isinstance(node.func, ast.Attribute):
            yield node, node.func.value
    elif isinstance(node, (ast.AugAssign, ast.Continue, ast.Break)) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    ):
        yield node, ast.Pass()


KINDS: dict[str, Callable[[ast.AST], Iterator[Edit]]] = {
    "sign": _signs,
    "side": _sides,
    "comparison": _comparisons,
    "number": _numbers,
    "term": _terms,
    "keyword": _keywords,
    "branch": _branches,
    "call": _calls,
}


def changes_of(package: Path) -> list[Change]:
    """Return every change of every file below the folder of a package, in a fixed order."""
    found: list[Change] = []
    for path in sorted(package.rglob("*.py")):
        found += _changes_in(path, path.relative_to(package.parent).as_posix())
    return found


def sample(changes: list[Change], number: int, seed: int, root: Path) -> list[Change]:
    """Return some of the changes, as many of each kind as can be: the same ones for the same seed.

    Parameters
    ----------
    changes : list of Change
    number, seed : int
    root : Path
        The folder that holds the package.
    """
    chosen = random.Random(seed)
    of_kind: dict[str, list[Change]] = defaultdict(list)
    for change in changes:
        of_kind[change.kind].append(change)
    for group in of_kind.values():
        chosen.shuffle(group)
    taken: list[Change] = []
    while len(taken) < number and any(of_kind.values()):
        for kind in KINDS:
            while of_kind[kind] and len(taken) < number:
                change = of_kind[kind].pop()
                if _differs(change, (root / change.file).read_bytes()):
                    taken.append(change)
                    break
    return taken


def _changes_in(path: Path, name: str) -> Iterator[Change]:
    source = path.read_bytes()
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node, inside in _code(ast.parse(source), False):
        for kind, edits in KINDS.items():
            for old, new in edits(node):
                span = (
                    starts[old.lineno - 1] + old.col_offset,  # type: ignore[attr-defined]
                    starts[old.end_lineno - 1] + old.end_col_offset,  # type: ignore[attr-defined]
                )
                before, after = source[slice(*span)].decode(), _text(new)
                lines = range(old.lineno, old.end_lineno + 1) if inside else ()  # type: ignore[attr-defined]
                yield Change(kind, name, old.lineno, frozenset(lines), before, after, span)  # type: ignore[attr-defined]


def _differs(change: Change, source: bytes) -> bool:
    """Tell whether a change leaves a program, and another one."""
    try:
        return ast.dump(ast.parse(change.applied(source))) != ast.dump(ast.parse(source))
    except SyntaxError:
        return False


def _code(node: ast.AST, inside: bool) -> Iterator[tuple[ast.AST, bool]]:
    """Return all nodes that run, and whether they stand inside a function."""
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "type_comment", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not _says(child):
                within = inside or isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef))
                yield child, within
                yield from _code(child, within)


def _says(node: ast.AST) -> bool:
    """Tell whether a part only says something: to readers, to type checkers, to whoever reads a message."""
    if isinstance(node, (ast.JoinedStr, ast.Assert, ast.Import, ast.ImportFrom, ast.Raise)):
        return True
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return True
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return True
    return isinstance(node, ast.Assign) and any(_name(target) == "__all__" for target in node.targets)


def _is_text(node: ast.BinOp | ast.AugAssign) -> bool:
    """Tell whether a sum joins texts."""
    return any(
        isinstance(part, ast.JoinedStr) or (isinstance(part, ast.Constant) and isinstance(part.value, str))
        for part in ast.walk(node)
    )


def _name(node: ast.AST) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _text(node: ast.AST) -> str:
    """Return the source of a node, such that it can stand where any other stood."""
    text = ast.unparse(ast.fix_missing_locations(node))
    plain = isinstance(node, (ast.Name, ast.Attribute, ast.Constant, ast.Call, ast.Subscript, ast.stmt))
    return text if plain else f"({text})"


def _one_line(text: str) -> str:
    return " ".join(text.split())
