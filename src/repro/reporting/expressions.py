"""Arithmetic expressions of claims.yaml, evaluated on their syntax tree: nothing else than the grammar can run.

expression = number | text | name | [expression, ...] | expression[integer] | -expression
           | expression (+ | - | * | /) expression | function(expression, ..., keyword=expression, ...)
"""

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from repro.system.errors import InputError

OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


@dataclass(frozen=True)
class Names:
    """What an expression may refer to.

    Args:
        values: numbers, texts and lists, by name.
        functions: functions, by name; they can be called and nothing else.
    """

    values: Mapping[str, Any]
    functions: Mapping[str, Callable[..., Any]] = field(default_factory=dict)


def evaluate(text: str, names: Names) -> Any:
    """Evaluate an expression.

    Args:
        text: the expression.
        names: what it may refer to.

    Raises:
        ValueError: the text is not an expression of the grammar, or refers to an unknown name.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"{text.strip()!r} is not an expression ({error})") from error
    return _evaluate(tree.body, names)


def _evaluate(node: ast.expr, names: Names) -> Any:
    match node:
        case ast.Constant(value=int() | float() | str() as value) if not isinstance(value, bool):
            return value
        case ast.Name(id=name) if name in names.values:
            return names.values[name]
        case ast.List(elts=elements):
            return [_evaluate(element, names) for element in elements]
        case ast.Subscript(value=ast.Name() as sequence, slice=ast.Constant(value=int() as index)):
            return _evaluate(sequence, names)[index]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_evaluate(operand, names)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            return OPERATORS[type(op)](_evaluate(left, names), _evaluate(right, names))
        case ast.Call(func=ast.Name(id=name), args=args, keywords=keywords) if name in names.functions:
            options = {str(keyword.arg): _evaluate(keyword.value, names) for keyword in keywords if keyword.arg}
            if len(options) == len(keywords):
                return names.functions[name](*(_evaluate(arg, names) for arg in args), **options)
    known = ", ".join([*names.values, *(f"{name}(...)" for name in names.functions)])
    raise InputError(f"{ast.unparse(node)!r} is not allowed: use numbers, + - * / and {known}")
