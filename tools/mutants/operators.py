"""The changes: those of cosmic-ray that a tired programmer makes by mistake, and two more in the same form."""

import re
from collections.abc import Callable, Iterable
from typing import Any, Final

from cosmic_ray.operators.operator import Example, Operator
from cosmic_ray.operators.provider import OperatorProvider
from parso.python.tree import Name
from parso.tree import search_ancestor

_TURNED_NAMES: Final = {
    name: other
    for one, two in (
        ("min", "max"),
        ("any", "all"),
        ("minimum", "maximum"),
        ("argmin", "argmax"),
        ("sin", "cos"),
        ("floor", "ceil"),
        ("logical_and", "logical_or"),
    )
    for name, other in ((one, two), (two, one))
}
Position = tuple[tuple[int, int], tuple[int, int]]


class TurnName(Operator):  # type: ignore[misc] # cosmic-ray has no types
    """Calls the opposite function: ``max`` for ``min``, ``any`` for ``all``."""

    def mutation_positions(self, node: Any) -> Iterable[Position]:
        """The name itself, where it is called."""
        named = node.type == "name" and node.value in _TURNED_NAMES and not node.is_definition()
        if named and getattr(node.get_next_leaf(), "value", "") == "(":
            yield node.start_pos, node.end_pos

    def mutate(self, node: Name, _index: int) -> Name:
        """The same node with the other name."""
        node.value = _TURNED_NAMES[node.value]
        return node

    @classmethod
    def examples(cls) -> tuple[Example, ...]:
        """As cosmic-ray's own operators have them."""
        return (Example("x = min(a, b)", "x = max(a, b)"), Example("np.any(a)", "np.all(a)"))


class ForgetField(Operator):  # type: ignore[misc] # cosmic-ray has no types
    """Forgets one field of ``dataclasses.replace``: a counter that is not reset, a time that is not noted."""

    def mutation_positions(self, node: Any) -> Iterable[Position]:
        """Each keyword argument of a call of ``replace``."""
        for argument in _replaced_fields(node):
            yield argument.start_pos, argument.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        """The call without its keyword argument number ``index``."""
        argument = _replaced_fields(node)[index]
        children = argument.parent.children
        place = children.index(argument)
        # The comma before it goes too.
        del children[place - 1 : place + 1]
        return node

    @classmethod
    def examples(cls) -> tuple[Example, ...]:
        """As cosmic-ray's own operators have them."""
        return (
            Example("replace(s, a=1, b=2)", "replace(s, b=2)"),
            Example("replace(s, a=1, b=2)", "replace(s, a=1)", occurrence=1),
        )


def _replaced_fields(node: Any) -> list[Any]:
    """The keyword arguments of a call of ``replace``, where the node is the bracket of one."""
    if node.type != "trailer" or node.children[0].value != "(" or node.children[1].type != "arglist":
        return []
    if getattr(node.get_previous_leaf(), "value", "") != "replace":
        return []
    arguments = [child for child in node.children[1].children[1:] if child.type == "argument"]
    return [argument for argument in arguments if getattr(argument.children[1], "value", "") == "="]


_COSMIC_RAY: Final = (
    "ReplaceBinaryOperator_Add_Sub",
    "ReplaceBinaryOperator_Sub_Add",
    "ReplaceBinaryOperator_Mul_Div",
    "ReplaceBinaryOperator_Div_Mul",
    "ReplaceBinaryOperator_Pow_Mul",
    "ReplaceBinaryOperator_BitAnd_BitOr",
    "ReplaceBinaryOperator_BitOr_BitAnd",
    "ReplaceComparisonOperator_Lt_LtE",
    "ReplaceComparisonOperator_LtE_Lt",
    "ReplaceComparisonOperator_Gt_GtE",
    "ReplaceComparisonOperator_GtE_Gt",
    "ReplaceComparisonOperator_Lt_GtE",
    "ReplaceComparisonOperator_LtE_Gt",
    "ReplaceComparisonOperator_Gt_LtE",
    "ReplaceComparisonOperator_GtE_Lt",
    "ReplaceComparisonOperator_Eq_NotEq",
    "ReplaceComparisonOperator_NotEq_Eq",
    "ReplaceComparisonOperator_Is_IsNot",
    "ReplaceComparisonOperator_IsNot_Is",
    "ReplaceUnaryOperator_USub_UAdd",
    "ReplaceUnaryOperator_Delete_Not",
    "ReplaceUnaryOperator_Delete_Invert",
    "AddNot",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "NumberReplacer",
)
"""Left out: what nobody types by mistake (``<<`` for ``+``). Every test notices it, and the score would flatter."""


def operators() -> dict[str, Callable[[], Operator]]:
    """The operators by name, in a fixed order."""
    provided = OperatorProvider()
    own = {operator.__name__: operator for operator in (TurnName, ForgetField)}
    return {**{name: provided[name] for name in _COSMIC_RAY}, **own}


_READERS: Final = {"number", "numbers", "integer"}
"""Read a number of a parameter file, with its bounds."""
_SETTINGS: Final = {"NumberReplacer", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue"}
_BOUNDARIES: Final = {
    "ReplaceComparisonOperator_Lt_LtE",
    "ReplaceComparisonOperator_LtE_Lt",
    "ReplaceComparisonOperator_Gt_GtE",
    "ReplaceComparisonOperator_GtE_Gt",
}
_MEASURED: Final = re.compile(
    r"\w+_(m|mps|mps2|mps3|s|rad|radps|1pm|1ps|1pms|hz|db|w|kg|share|rate)\b|\d\.\d|\d\.(?!\w)"
)
"""By this project's rule names say the unit: these are units of measured numbers."""


def is_of_interest(name: str, node: Any) -> bool:
    """Whether a change of this node could be a defect.

    None is: another number of a setting (a constant of the module, the default of a field, a bound of a parameter), of
    an annotation, of a decorator or of an error's message; whether ``zip`` checks lengths; and whether a limit itself
    counts as inside, where measured numbers are compared (by their units or a decimal point): no measured number is
    just that.
    """
    if name == "AddNot" and _condition(node).type in {"comparison", "not_test", "and_test", "or_test"}:
        return False  # Other operators turn these.
    if name in _BOUNDARIES and _MEASURED.search(node.get_code()):
        return False
    inside = node
    while inside.parent is not None:
        if _is_no_decision(name, inside):
            return False
        inside = inside.parent
    return True


def _is_no_decision(name: str, node: Any) -> bool:
    """Whether a node that the change lies in says how a program is written rather than what it does."""
    outside = node.parent
    star = node.type == "operator" and outside.type == "parameters"  # Before parameters that have to be named.
    checked = node.type == "argument" and node.get_code().strip() in {"strict=True", "strict=False"}  # Of ``zip``.
    if star or checked or node.type in {"decorator", "raise_stmt", "assert_stmt", "import_from", "tfpdef"}:
        return True
    if (
        name == "NumberReplacer"
        and node.type == "trailer"
        and getattr(node.get_previous_leaf(), "value", "") in _READERS
    ):
        return True  # Another bound of a parameter.
    if outside.type == "annassign" and node is outside.children[1]:
        return True  # An annotation.
    if outside.type == "funcdef" and outside.annotation is node:
        return True
    return node.type == "expr_stmt" and _is_setting(name, node)


def _condition(node: Any) -> Any:
    """What ``AddNot`` turns."""
    return node.children[2] if node.type == "test" else node.children[1]


def _is_setting(name: str, statement: Any) -> bool:
    """Whether the statement is the default of a field, or one that gives a constant of the module its number."""
    scope = search_ancestor(statement, "classdef", "funcdef")
    return scope.type == "classdef" if scope is not None else name in _SETTINGS
