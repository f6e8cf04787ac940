"""An interpreter of structured text, on the syntax tree of the parser blark.

It understands only what plan-export writes and what the clients in tools/docs/clients use. It is stricter
than a controller: both sides of AND and OR are computed, and an index outside of its array, a number outside
of its type, a text longer than its variable or an unknown name is an error.
"""

import operator
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import blark
from blark import transform as st
from blark.parse import BlarkStartingRule, parse_source_code
from lark import Lark

OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "=": operator.eq,
    "<>": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "AND": operator.and_,
    "OR": operator.or_,
}
INPUT, OUTPUT, LOCAL = "input", "output", "local"
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "CONCAT": lambda first, second: first + second,
    "FIND": lambda text, sought: text.find(sought) + 1,
    "LEFT": lambda text, length: text[:length],
    "RIGHT": lambda text, length: text[len(text) - length :],
    "LEN": len,
    "STRING_TO_REAL": float,
    "DINT_TO_STRING": str,
}
"""Functions of IEC 61131-3; positions count from 1, and FIND returns 0 if there is no match."""
INTEGERS = {"INT": 2**15, "DINT": 2**31}
FIRST = {"BOOL": False, "INT": 0, "DINT": 0, "REAL": 0.0, "STRING": ""}
BLOCKS = {st.InputDeclarations: INPUT, st.OutputDeclarations: OUTPUT}
BLOCKS[st.VariableDeclarations] = LOCAL


NARROWED = {
    '| array_initial_element ( "," array_initial_element )*         -> bare_array_initialization': "",
    "| _array_initial_element\n\n": "| integer_literal\n\n",
}
"""Rules of blark's grammar with simpler replacements, which save most of the time of parsing.

Arrays without brackets take cubic time, and arrays of expressions most of the rest.
"""


@cache
def parser() -> Lark:
    """Returns a parser of structured text in which initial values of arrays are integers in brackets."""
    grammar = blark.GRAMMAR_FILENAME.read_text()
    for general, narrow in NARROWED.items():
        assert grammar.count(general) == 1
        grammar = grammar.replace(general, narrow)
    starts = [rule.name for rule in BlarkStartingRule]
    how = {"maybe_placeholders": True, "propagate_positions": True}
    return Lark(grammar, parser="earley", start=starts, **how)


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
        self._kinds: dict[str, str] = {}
        self.names: dict[str, list[str]] = {INPUT: [], OUTPUT: [], LOCAL: []}
        for declarations in block.declarations:
            self._declare(declarations)
        self._body = block.body

    def __call__(self, **inputs: Any) -> dict[str, Any]:
        """Calls the block with inputs; returns its outputs."""
        assert set(inputs) == set(self.names[INPUT])
        self.values |= {name: _fitted(self._kinds[name], value) for name, value in inputs.items()}
        self._run(self._body)
        return {name: self.values[name] for name in self.names[OUTPUT]}

    def _declare(self, declarations: Any) -> None:
        kind = BLOCKS[type(declarations)]
        for item in declarations.items:
            (declared,) = item.variables
            name = str(declared.variable.name).lower()
            assert name not in self.values, f"{name} is declared twice"
            self._kinds[name], self.values[name] = self._first(item)
            self.names[kind].append(name)
            if declarations.attrs == st.VariableAttributes.constant:
                self._constants.add(name)

    def _first(self, item: Any) -> tuple[str, Any]:
        """The type of a variable (of its elements, if it is an array), and its initial value."""
        kind = str(item.init.spec.type)
        first = FIRST[kind.partition("[")[0]]
        if isinstance(item, st.ArrayVariableInitDeclaration):
            (bounds,) = item.init.spec.subranges
            assert self._value(bounds.start) == 0
            size = self._value(bounds.stop) + 1
            if item.init.value is None:
                return kind, [first] * size
            values = [_fitted(kind, self._value(each.element)) for each in item.init.value.elements]
            assert len(values) == size, "as many values as the array has"
            return kind, values
        if item.init.value is None:
            return kind, first
        return kind, _fitted(kind, self._value(item.init.value))

    def _run(self, statements: Any) -> bool:
        """Executes a list of statements; returns whether an EXIT ended it early."""
        return any(map(self._left, statements.statements if statements else ()))

    def _left(self, statement: Any) -> bool:
        """Executes a statement; returns whether it is an EXIT, or an IF in which an EXIT was executed."""
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
        """The statements of the branch that an IF takes."""
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
            self.values[name] = _fitted(self._kinds[name], number)
            if self._run(statement.statements):
                return

    def _assign(self, statement: Any) -> None:
        (variable,) = statement.variables
        array = variable.name if isinstance(variable, st.MultiElementVariable) else None
        name = str(array or variable.name).lower()
        assert name not in self._constants, f"{name} is constant"
        assert name not in self.names[INPUT], f"{name} is an input"
        value = _fitted(self._kinds[name], self._value(statement.expression))
        if array is None:
            assert not isinstance(self.values[name], list)
            self.values[name] = value
        else:
            self.values[name][self._index(variable)] = value

    def _value(self, expression: Any) -> Any:
        if isinstance(expression, st.Integer):
            return int(expression.value)
        if isinstance(expression, st.Boolean):
            return str(expression.value).upper() == "TRUE"
        if isinstance(expression, st.String):
            return str(expression.value)[1:-1]
        if isinstance(expression, st.SimpleVariable):
            return self.values[str(expression.name).lower()]
        if isinstance(expression, st.MultiElementVariable):
            return self._value(expression.name)[self._index(expression)]
        if isinstance(expression, st.FunctionCall):
            given = (self._value(each.value) for each in expression.parameters)
            return FUNCTIONS[str(expression.name)](*given)
        if isinstance(expression, st.ParenthesizedExpression):
            return self._value(expression.expr)
        if isinstance(expression, st.UnaryOperation):
            assert str(expression.op) == "-"
            return -self._value(expression.expr)
        if isinstance(expression, st.BinaryOperation):
            left, right = self._value(expression.left), self._value(expression.right)
            assert type(left) is type(right)
            value = OPERATORS[str(expression.op).upper()](left, right)
            return value if isinstance(value, bool) else _fitted("DINT", value)
        raise TypeError(f"{type(expression).__name__} is not in the subset")

    def _index(self, variable: Any) -> int:
        """The index of an element of an array."""
        ((subscript,),) = [element.subscripts for element in variable.elements]
        index = self._value(subscript)
        assert index >= 0, "an index below its array"
        return int(index)


def _fitted(kind: str, value: Any) -> Any:
    """Checks that a value fits a variable's type, and returns it as the variable holds it."""
    base, _, length = kind.partition("[")
    assert type(value) is type(FIRST[base]), f"{value!r} is no {kind}"
    if base in INTEGERS:
        assert -INTEGERS[base] <= value < INTEGERS[base]
    elif base == "STRING":
        assert value.isascii()
        assert len(value) <= int(length.rstrip("]")), f"{value!r} is longer than {kind}"
    elif base == "REAL":
        return struct.unpack("f", struct.pack("f", value))[0]
    return value
