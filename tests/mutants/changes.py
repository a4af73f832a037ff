"""Small bugs for a Python file: each change is one that a slip of the pen could make.

Operators of arithmetic and comparison, `and` and `or`, signs, numbers, extremes (min and max, sin and cos, floor and
ceil), and dropped statements. A number in a formula is doubled (a whole number: one more); a number that was chosen, the
default of a setting or a constant of a module, becomes ten times as large: another choice is no bug, another unit is.

Not changed: annotations, docstrings, imports, decorators, and what only words an error. Nor is the first binding of a
name dropped: every test would notice.

Source: DeMillo, Lipton, Sayward 1978 (mutation analysis); the list is ours.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from typing import NamedTuple

ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Div, ast.Mod: ast.Mult, ast.MatMult: ast.Mult, ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd, ast.LShift: ast.RShift, ast.RShift: ast.LShift,
}  # fmt: skip
COMPARISON: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
}  # fmt: skip
TWINS = (
    ("min", "max"), ("minimum", "maximum"), ("fmin", "fmax"), ("nanmin", "nanmax"),
    ("argmin", "argmax"), ("sin", "cos"), ("floor", "ceil"), ("any", "all"),
)  # fmt: skip
OTHER = {one: other for pair in TWINS for one, other in (pair, pair[::-1])}
UNTOUCHED = (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom)
NO_FORMULA = ("annotation", "returns", "decorator_list", "bases")
CHOSEN_TIMES = 10


class Change(NamedTuple):
    """One bug.

    Args:
        number: Its place in the list of the file.
        line, column: Its place in the file.
        function: Name of the function, with its class; empty for what stands outside.
        kind: "arithmetic", "comparison", "logic", "sign", "number", "extreme" or "dropped".
        before, after: The code.
        text: The whole line.
    """

    number: int
    line: int
    column: int
    function: str
    kind: str
    before: str
    after: str
    text: str


class _Spot(NamedTuple):
    """A node, where it hangs in the tree, and what replaces it."""

    parent: ast.AST
    field: str
    position: int | None
    node: ast.expr | ast.stmt
    function: str
    kind: str
    wrong: ast.AST

    def put(self, node: ast.AST) -> None:
        """Hang a node there."""
        if self.position is None:
            setattr(self.parent, self.field, node)
        else:
            getattr(self.parent, self.field)[self.position] = node


def changes(source: str) -> list[Change]:
    """All bugs of a file, always in the same order."""
    lines, found = source.splitlines(), []
    for number, (_, _, _, node, function, kind, wrong) in enumerate(_spots(ast.parse(source), "")):
        code = ast.unparse(node), ast.unparse(wrong)
        text = lines[node.lineno - 1].strip()
        found.append(Change(number, node.lineno, node.col_offset, function, kind, *code, text))
    return found


def changed(source: str, number: int) -> str:
    """The file with one bug."""
    tree = ast.parse(source)
    spot = list(_spots(tree, ""))[number]
    spot.put(spot.wrong)
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n"


def _spots(node: ast.AST, function: str) -> Iterator[_Spot]:
    inner = function
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        inner = f"{function}.{node.name}".lstrip(".")
    in_function = inner if not isinstance(node, ast.ClassDef) else f"{inner}:"
    for field, value in ast.iter_fields(node):
        if field in NO_FORMULA:
            continue
        many = isinstance(value, list)
        for position, child in enumerate(value if many else [value]):
            if not isinstance(child, ast.AST) or isinstance(child, UNTOUCHED):
                continue
            if isinstance(child, ast.expr | ast.stmt):
                for kind, wrong in _wrong(child, chosen=_is_outside(in_function)):
                    yield _Spot(
                        node, field, position if many else None, child, in_function, kind, wrong
                    )
            yield from _spots(child, in_function)


def _is_outside(function: str) -> bool:
    """Whether this is the body of a module or of a class."""
    return not function or function.endswith(":")


def _wrong(node: ast.expr | ast.stmt, chosen: bool) -> Iterator[tuple[str, ast.AST]]:
    """Kinds and wrong forms of one node."""
    match node:
        case ast.BinOp(op=op) if type(op) in ARITHMETIC:
            yield "arithmetic", _with(node, op=ARITHMETIC[type(op)]())
        case ast.AugAssign(op=op) if type(op) in ARITHMETIC:
            yield "arithmetic", _with(node, op=ARITHMETIC[type(op)]())
            yield "dropped", ast.Pass()
        case ast.Compare(ops=[*ops]):
            for k, op in enumerate(ops):
                if type(op) in COMPARISON:
                    swapped = [*ops[:k], COMPARISON[type(op)](), *ops[k + 1 :]]
                    yield "comparison", _with(node, ops=swapped)
        case ast.BoolOp(op=op):
            yield "logic", _with(node, op=ast.Or() if isinstance(op, ast.And) else ast.And())
        case ast.UnaryOp(op=ast.USub()):
            yield "sign", node.operand
        case ast.UnaryOp(op=ast.Not()):
            yield "logic", node.operand
        case ast.Call(func=ast.Name(id=name) as called) if name in OTHER:
            yield "extreme", _with(node, func=_with(called, id=OTHER[name]))
        case ast.Call(func=ast.Attribute(attr=name) as called) if name in OTHER:
            yield "extreme", _with(node, func=_with(called, attr=OTHER[name]))
        case ast.Constant(value=bool()):
            pass
        case ast.Constant(value=(int() | float()) as number):
            yield "number", ast.Constant(_other_number(number, chosen))
        case ast.Expr(value=ast.Call()) | ast.Continue() | ast.Break():
            yield "dropped", ast.Pass()
        case ast.Assign(targets=[ast.Subscript() | ast.Attribute()]):
            yield "dropped", ast.Pass()


def _other_number(number: float, chosen: bool) -> float:
    if number == 0:
        return type(number)(1)
    if chosen:
        return number * CHOSEN_TIMES
    return number + 1 if isinstance(number, int) else 2.0 * number


def _with(node: ast.AST, **fields: object) -> ast.AST:
    """A shallow copy with other fields."""
    other = copy.copy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return other
