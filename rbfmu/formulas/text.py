"""A formula's text: which of Python's expressions it may be, and where a mistake is. It is parsed, never run."""

import ast
from collections.abc import Iterator

LONGEST, DEEPEST = 2000, 40
"""The most characters of a formula, and levels of what stands inside something else."""
OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**", ast.MatMult: "@"}
COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
_ALLOWED = (
    ast.Expression, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.Call, ast.Name, ast.Constant, ast.List,
    ast.Tuple, ast.Subscript, ast.Load, ast.USub, ast.UAdd, ast.Not, ast.And, ast.Or, *OPERATORS, *COMPARISONS,
)  # fmt: skip
_INSTEAD = {
    ast.BitXor: "** for a power", ast.FloorDiv: "/", ast.IfExp: "where(condition, a, b)", ast.Eq: "<, <=, > or >=",
    ast.NotEq: "<, <=, > or >=", ast.Attribute: "a name or a number",
}  # fmt: skip


class FormulaError(ValueError):
    """What is wrong with a formula, and where: its text with a caret below, and what was expected."""

    def __init__(self, text: str, column: int, expected: str) -> None:
        shown, at = _window(text, column)
        super().__init__(f"expected {expected}\n    {shown}\n    {' ' * at}^")
        self.expected = expected


def _window(text: str, column: int, width: int = 100) -> tuple[str, int]:
    """Return the part of a text about a column, in one line, and where the column stands in it."""
    flat = "".join(c if c.isprintable() else " " for c in text)
    first = max(0, min(column - width // 2, len(flat) - width))
    return flat[first : first + width], column - first


def read(text: str) -> ast.expr:
    """Return the expression of a text, of allowed parts alone. Raises FormulaError."""
    if len(text) > LONGEST:
        raise FormulaError(text, LONGEST, f"at most {LONGEST} characters")
    depth = 0
    for column, character in enumerate(text):  # before Python's parser, which gives up on thousands of levels
        depth += (character in "([{") - (character in ")]}")
        if depth > DEEPEST:
            raise FormulaError(text, column, f"at most {DEEPEST} levels")
    flat = " ".join(text.split("\n")) if "\n" in text else text  # a formula may take several lines of a file
    try:
        found = ast.parse(f"({flat})", mode="eval").body
    except SyntaxError as error:
        column = min(max((error.offset or 2) - 2, 0), len(text))
        raise FormulaError(text, column, "a formula") from None
    except (ValueError, MemoryError, RecursionError):  # zero bytes; thousands of signs in a row
        raise FormulaError(text, 0, "a formula") from None
    for node, level in _walk(found):
        if level > 2 * DEEPEST:
            raise FormulaError(text, column_of(text, node), f"at most {2 * DEEPEST} operations inside each other")
        if not isinstance(node, _ALLOWED):
            instead = _INSTEAD.get(type(node), "numbers, names, operators, functions, [ , ]")
            raise FormulaError(text, column_of(text, node), instead)
    return found


def column_of(text: str, node: ast.AST) -> int:
    """Return the column at which a part of the text begins; Python counts bytes, from a bracket that `read` puts."""
    before = text.encode()[: max(getattr(node, "col_offset", 1) - 1, 0)]
    return len(before.decode(errors="ignore"))


def _walk(root: ast.expr) -> Iterator[tuple[ast.AST, int]]:
    """Yield all parts, and how deep they stand; an operator comes with the place of its operation."""
    left: list[tuple[ast.AST, int]] = [(root, 0)]
    while left:
        node, level = left.pop()
        yield node, level
        for part in ast.iter_child_nodes(node):
            if not hasattr(part, "col_offset"):
                part.col_offset = getattr(node, "col_offset", 1)  # type: ignore[attr-defined]
            left.append((part, level + 1))


def names_in(text: str) -> set[str]:
    """Return the names that a formula reads. Raises FormulaError."""
    return {node.id for node, _ in _walk(read(text)) if isinstance(node, ast.Name)}
