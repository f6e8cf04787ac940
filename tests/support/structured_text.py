"""An interpreter of the structured text that plan-export writes, on the syntax tree of the parser blark.

Only what those files use is understood, and it is stricter than a controller: both sides of AND and OR are
computed, an index outside of its array, a number outside of 32 bits or an unknown name is an error.
"""

import operator
from collections.abc import Callable
from functools import cache
from typing import Any

import blark
from blark import transform as st
from blark.parse import BlarkStartingRule, parse_source_code
from lark import Lark

OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add, "-": operator.sub, "=": operator.eq, "<>": operator.ne, "<": operator.lt,
    "<=": operator.le, ">": operator.gt, ">=": operator.ge, "AND": operator.and_, "OR": operator.or_,
}  # fmt: skip
INPUT, OUTPUT, LOCAL = "input", "output", "local"
BLOCKS = {st.InputDeclarations: INPUT, st.OutputDeclarations: OUTPUT, st.VariableDeclarations: LOCAL}


@cache
def parser() -> Lark:
    """The parser without arrays that lack brackets, by which it takes cubic time for those that have them."""
    bare = '| array_initial_element ( "," array_initial_element )*         -> bare_array_initialization'
    grammar = blark.GRAMMAR_FILENAME.read_text()
    assert grammar.count(bare) == 1
    start = [rule.name for rule in BlarkStartingRule]
    return Lark(
        grammar.replace(bare, ""), parser="earley", maybe_placeholders=True, propagate_positions=True,
        start=start,
    )  # fmt: skip


class FunctionBlock:
    """An instance of the one function block of a source; its variables keep their values between calls."""

    def __init__(self, source: str) -> None:
        parsed = parse_source_code(source, parser=parser())
        if parsed.exception is not None:
            raise parsed.exception
        (block,) = parsed.transform().items
        assert isinstance(block, st.FunctionBlock)
        self.values: dict[str, Any] = {}
        self._constants: set[str] = set()
        self.names: dict[str, list[str]] = {INPUT: [], OUTPUT: [], LOCAL: []}
        for declarations in block.declarations:
            self._declare(declarations)
        self._body = block.body

    def __call__(self, **inputs: int) -> dict[str, Any]:
        """Call the block; returns its outputs."""
        assert set(inputs) == set(self.names[INPUT])
        self.values |= inputs
        self._run(self._body)
        return {name: self.values[name] for name in self.names[OUTPUT]}

    def _declare(self, declarations: Any) -> None:
        kind = BLOCKS[type(declarations)]
        for item in declarations.items:
            (declared,) = item.variables
            name = str(declared.variable.name).lower()
            assert name not in self.values, f"{name} is declared twice"
            self.values[name] = self._first(item)
            self.names[kind].append(name)
            if declarations.attrs == st.VariableAttributes.constant:
                self._constants.add(name)

    def _first(self, item: Any) -> Any:
        """The value that a variable begins with."""
        if isinstance(item, st.ArrayVariableInitDeclaration):
            (bounds,) = item.init.spec.subranges
            values = [self._checked(self._value(each.element)) for each in item.init.value.elements]
            assert str(item.init.spec.type.type_name) == "DINT"
            assert self._value(bounds.start) == 0
            assert self._value(bounds.stop) == len(values) - 1, "as many values as the array has"
            return values
        kind = str(item.init.spec.type)
        assert kind in ("BOOL", "DINT"), kind
        if item.init.value is not None:
            return self._checked(self._value(item.init.value))
        return False if kind == "BOOL" else 0

    def _run(self, statements: Any) -> bool:
        """Execute a list of statements; whether it ended with EXIT."""
        return any(self._left(statement) for statement in (statements.statements if statements else ()))

    def _left(self, statement: Any) -> bool:
        """Execute a statement; whether EXIT ends the statements that it stands among."""
        if isinstance(statement, st.ExitStatement):
            return True
        if isinstance(statement, st.IfStatement):
            return self._run(self._chosen(statement))
        if isinstance(statement, st.ForStatement):
            self._loop(statement)
        elif isinstance(statement, st.AssignmentStatement):
            self._assign(statement)
        else:
            raise TypeError(f"{type(statement).__name__} is not in the subset")
        return False

    def _chosen(self, statement: Any) -> Any:
        """The statements that an IF comes to."""
        clauses = [(statement.if_expression, statement.statements)]
        clauses += [(other.if_expression, other.statements) for other in statement.else_ifs]
        for condition, inner in clauses:
            held = self._value(condition)
            assert isinstance(held, bool)
            if held:
                return inner
        return statement.else_clause and statement.else_clause.statements

    def _loop(self, statement: Any) -> None:
        assert statement.step is None
        name = str(statement.control.name).lower()
        for number in range(self._value(statement.from_), self._value(statement.to) + 1):
            self.values[name] = self._checked(number)
            if self._run(statement.statements):
                return

    def _assign(self, statement: Any) -> None:
        (variable,) = statement.variables
        name = str(variable.name).lower()
        assert name not in self._constants, f"{name} is constant"
        assert name not in self.names[INPUT], f"{name} is an input"
        value = self._checked(self._value(statement.expression))
        assert type(value) is type(self.values[name])
        self.values[name] = value

    def _value(self, expression: Any) -> Any:
        if isinstance(expression, st.Integer):
            return int(expression.value)
        if isinstance(expression, st.SimpleVariable):
            return self.values[str(expression.name).lower()]
        if isinstance(expression, st.MultiElementVariable):
            ((subscript,),) = [element.subscripts for element in expression.elements]
            index = self._value(subscript)
            assert index >= 0, "an index below its array"
            return self._value(expression.name)[index]
        if isinstance(expression, st.ParenthesizedExpression):
            return self._value(expression.expr)
        if isinstance(expression, st.UnaryOperation):
            assert str(expression.op) == "-"
            return -self._value(expression.expr)
        if isinstance(expression, st.BinaryOperation):
            left, right = self._value(expression.left), self._value(expression.right)
            assert type(left) is type(right)
            return self._checked(OPERATORS[str(expression.op).upper()](left, right))
        raise TypeError(f"{type(expression).__name__} is not in the subset")

    @staticmethod
    def _checked(value: Any) -> Any:
        """The value, if a DINT holds it or it is a BOOL."""
        assert isinstance(value, bool) or -(2**31) <= value < 2**31
        return value
