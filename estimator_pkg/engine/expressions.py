# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Expressions of the subset as C, with Python's meaning and with a kind for each."""

import ast
import math
import operator
from typing import Any, NamedTuple, NoReturn

from . import kinds as k
from .kinds import BOOL, COMPLEX, FLOAT, INT, WHOLE
from .prelude import KEYWORDS, MATH, TESTS
from .sources import Found, Module, Outside

TERNARY, OR, AND, BITS, EQUAL, ORDER, SUM, PRODUCT, UNARY, ATOM = range(10)  # tighter in C
ARITHMETIC: dict[type, tuple[str, int]] = {
    ast.Add: ('+', SUM),
    ast.Sub: ('-', SUM),
    ast.Mult: ('*', PRODUCT),
    ast.Div: ('/', PRODUCT),
}
OF_COMPLEX: dict[type, str] = {
    ast.Add: 'complex_add',
    ast.Sub: 'complex_subtract',
    ast.Mult: 'complex_multiply',
    ast.Eq: 'complex_equal',
}
MASKS: dict[type, str] = {ast.BitAnd: '&', ast.BitOr: '|'}  # of ints
COMPARISONS: dict[type, tuple[str, int, Any]] = {
    ast.Lt: ('<', ORDER, operator.lt),
    ast.LtE: ('<=', ORDER, operator.le),
    ast.Gt: ('>', ORDER, operator.gt),
    ast.GtE: ('>=', ORDER, operator.ge),
    ast.Eq: ('==', EQUAL, operator.eq),
    ast.NotEq: ('!=', EQUAL, operator.ne),
}
CONSTANTS = {f'math.{name}': getattr(math, name) for name in ('pi', 'tau', 'e', 'inf', 'nan')}
REMEDIES: dict[type, str] = {
    ast.Pow: ': write the product, or math.pow',
    ast.List: ': declare a record with a vector',
    ast.Tuple: ': unpack it at once, or use a record',
    ast.Slice: ': write a loop',
}


class Value(NamedTuple):
    """An expression in C."""

    text: str
    kind: Any
    level: int = ATOM
    constant: Any = None  # its value, where it is known at translation
    reads: bool = False  # reads a record or an array
    writes: bool = False  # calls a function that changes one
    pointer: bool = False  # of a record: the text is a pointer
    own: bool = False  # of a record: the function made it itself
    real: str = ''  # of an int: the double that is equal to it

    def above(self, level: int) -> str:
        """Return the text, in parentheses unless it binds tighter than ``level``."""
        return self.text if self.level > level else f'({self.text})'

    @property
    def address(self) -> str:
        """Text of the argument that passes it on."""
        return (
            f'&{self.text}' if isinstance(self.kind, k.Record) and not self.pointer else self.text
        )


class Local:
    """A name of a function."""

    def __init__(self, text: str, kind: Any, pointer: bool, own: bool) -> None:
        self.text, self.kind, self.pointer, self.own, self.read = text, kind, pointer, own, False
        self.written = False  # what it points to
        self.of: list[Local] = []  # those that an alias comes from

    def use(self) -> None:
        """Note that it is read, and so what it comes from."""
        self.read = True
        for local in self.of:
            local.use()

    def write(self) -> None:
        """Note that what it points to is changed."""
        self.written = True
        for local in self.of:
            local.write()


def number(value: Any) -> str:
    """Return a number that is exact in C."""
    if value is True or value is False or value != value:
        return {True: 'true', False: 'false'}.get(value, 'NAN')
    sign, size = '-' if math.copysign(1.0, value) < 0.0 else '', abs(value)
    if isinstance(value, float):
        short = f'{size:.0e}'.replace('e+0', 'e').replace('e+', 'e').replace('e-0', 'e-')
        short = short if size >= 1e5 and float(short) == size else repr(size)
        return sign + ('INFINITY' if math.isinf(value) else short)
    if value == -(2**63):
        return 'INT64_MIN'
    return f'{sign}{size}'


class Expressions:
    """The expressions of one function."""

    def __init__(self, translator: Any, module: Module, static: dict[str, Module]) -> None:
        self.translator, self.module, self.static = translator, module, static
        self.sources = translator.sources
        self.locals: dict[str, Local] = {}
        self.assigned: set[str] = set()  # all names that the function assigns
        self.writes = False  # the function changes a record or an array of its caller

    def refuse(self, node: Any, reason: str) -> NoReturn:
        """Raise a RefusedError at a node."""
        self.module.refuse(node, reason)

    def not_translated(self, node: ast.AST, remedy: str = '') -> NoReturn:
        """Refuse a node for what it is."""
        self.refuse(node, f'{ast.unparse(node)!r} is not translated{remedy}')

    def expression(self, node: ast.AST) -> Value:
        """Return any expression of the subset as C."""
        method = METHODS.get(type(node))
        if method is None:
            self.not_translated(node, REMEDIES.get(type(node), ''))
        return method(self, node)  # type: ignore[no-any-return]

    def one_of(self, node: ast.AST, kinds: Any, what: str) -> Value:
        """Return an expression that has one of some kinds."""
        value = self.expression(node)
        if value.kind not in kinds:
            self.refuse(node, f'{ast.unparse(node)!r} is {value.kind}, not {what}')
        return value

    def number(self, node: ast.AST) -> Value:
        """Return an expression that is a number."""
        return self.one_of(node, (FLOAT, INT, WHOLE, COMPLEX), 'a number')

    def condition(self, node: ast.AST) -> Value:
        """Return an expression that is a bool."""
        return self.one_of(node, (BOOL,), 'bool: write a comparison')

    def lookup(self, node: ast.AST) -> Found | Module | Outside | None:
        """Return what a dotted name refers to at translation; None where it is a value."""
        values = dict.fromkeys((*self.locals, *self.assigned))
        return self.sources.dotted(self.module, node, {**self.static, **values})  # type: ignore

    def in_order(self, node: ast.AST, *values: Value) -> dict[str, Any]:
        """Return what operands read and write; refuse those whose order C leaves open."""
        writes = any(value.writes for value in values)
        if writes and sum(value.reads for value in values) > 1:
            call = next(ast.unparse(item) for item in ast.walk(node) if isinstance(item, ast.Call))
            self.refuse(node, f'the order of evaluation matters: assign {call!r} to a name first')
        return {'reads': any(value.reads for value in values), 'writes': writes}

    def roots(self, node: ast.AST) -> list[Local]:
        """Return the locals that an expression reads."""
        names = [item.id for item in ast.walk(node) if isinstance(item, ast.Name)]
        return [self.locals[name] for name in names if name in self.locals]

    def reads(self) -> dict[Local, bool]:
        """Return which locals are read so far."""
        return {local: local.read for local in self.locals.values()}

    @staticmethod
    def unread(before: dict[Local, bool]) -> None:
        """Forget what was read since `reads`."""
        for local, read in before.items():
            local.read = read

    def changed(self, node: ast.AST) -> None:
        """Note that an expression names what is changed."""
        for local in self.roots(node):
            local.write()

    def literal(self, value: Any, node: ast.AST) -> Value:
        """Return a constant."""
        if type(value) is complex:
            parts = (self.literal(part, node) for part in (value.real, value.imag))
            return self.helper('complex_of', COMPLEX, *parts)
        if type(value) not in (bool, float, int):
            self.refuse(node, f'{value!r} is no number')
        if type(value) is int and not -(2**63) <= value < 2**63:
            self.refuse(node, f'{value} does not fit into 64 bits')
        text = number(value)
        return Value(
            text, k.NUMBERS[type(value).__name__], UNARY if text[0] == '-' else ATOM, value
        )

    def _on_constant(self, node: ast.Constant) -> Value:
        return self.literal(node.value, node)

    def _on_name(self, node: ast.Name) -> Value:
        local = self.locals.get(node.id)
        if local is None:
            return self._on_global(node, self.lookup(node))
        local.use()
        return Value(local.text, local.kind, pointer=local.pointer, own=local.own)

    def _on_global(self, node: ast.AST, found: Any) -> Value:
        """Return what a name of a module says: a constant, or a module that is passed on."""
        text = ast.unparse(node)
        if isinstance(found, Module):
            return Value('', k.Static(found))
        if isinstance(found, Outside) and found.name in CONSTANTS:
            return self.literal(CONSTANTS[found.name], node)
        if text in self.assigned:
            self.refuse(node, f'{text!r} is used before it is assigned')
        if not isinstance(found, Found) or not isinstance(found.node, ast.expr):
            self.refuse(node, f'{text!r} is no local, no constant of a module and nothing of math')
        constant = self.sources.constant(found)
        if type(constant) is bool:
            return self.literal(constant, node)
        if not isinstance(constant, tuple):
            value = self.literal(constant, node)
            name = self.translator.constant(found, constant, value.kind)
            return value._replace(text=name, level=ATOM)
        kinds = {self.literal(item, node).kind for item in constant}
        if len(kinds) > 1:
            self.refuse(node, f'{text!r} is not translated: its values are not of one type')
        kind = k.Vector(len(constant), kinds.pop())
        return Value(self.translator.constant(found, constant, kind), kind, constant=constant)

    def _on_attribute(self, node: ast.Attribute) -> Value:
        found = self.lookup(node)
        if found is not None:
            return self._on_global(node, found)
        before = self.reads()
        owner = self.expression(node.value)
        if owner.kind == COMPLEX and node.attr in ('real', 'imag'):
            return owner._replace(text=f'{owner.above(UNARY)}.{node.attr}', kind=FLOAT, level=ATOM)
        fields = (
            self.translator.kinds.fields(owner.kind) if isinstance(owner.kind, k.Record) else {}
        )
        if node.attr not in fields:
            text = ast.unparse(node.value)
            self.refuse(node, f'{text!r} is {owner.kind}, which has no field {node.attr!r}')
        kind = fields[node.attr]
        known = self.translator.known_value(owner.kind, node.attr)
        if known is not None:
            self.unread(before)
            return self._known(node, owner.kind, known, kind)
        self.translator.reached.add((owner.kind.module.name, owner.kind.node.name, node.attr))
        text = f'{owner.text}{"->" if owner.pointer else "."}{node.attr}'
        reads = owner.reads or isinstance(kind, k.Kind)
        text += '_' * (node.attr in KEYWORDS)
        return owner._replace(text=text, kind=kind, pointer=False, reads=reads)

    def _known(self, node: ast.Attribute, record: k.Record, value: Any, kind: Any) -> Value:
        """Return a field whose value is known at translation: a gain of a header."""
        if type(value) is bool:
            return self.literal(value, node)
        text = self.translator.gain(record, node.attr, value, kind)
        return Value(text, kind, constant=value)

    def _on_subscript(self, node: ast.Subscript) -> Value:
        owner, index = self.expression(node.value), self.expression(node.slice)
        if not isinstance(owner.kind, (k.Vector, k.Array)):
            self.refuse(node, f'{ast.unparse(node.value)!r} is {owner.kind}, which has no index')
        if index.kind != INT:
            self.refuse(node, f'index {ast.unparse(node.slice)!r} is {index.kind}, not int')
        at, count = index.constant, getattr(owner.kind, 'count', 2**63)
        if at is not None and not (-count <= at < count and (at >= 0 or count < 2**63)):
            self.refuse(node, f'index {at} is not in {owner.kind}')
        text = index.text if at is None or at >= 0 else str(at + count)
        kind = INT if getattr(owner.kind.of, 'text', '') == 'int' else owner.kind.of
        flags = self.in_order(node, owner, index)
        flags['reads'] |= owner.constant is None and isinstance(kind, k.Kind)
        pointer = isinstance(owner.kind, k.Array) and isinstance(kind, k.Record)
        text = f'{owner.text}[{text}]'
        return owner._replace(text=text, kind=kind, constant=None, pointer=pointer, **flags)

    def _on_unary(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            value = self.condition(node.operand)
            if value.constant is not None:
                return self.literal(not value.constant, node)
            return value._replace(text=f'!{value.above(PRODUCT)}', level=UNARY)
        if not isinstance(node.op, (ast.USub, ast.UAdd)):
            self.not_translated(node)
        inner, minus = node.operand, isinstance(node.op, ast.USub)
        if minus and isinstance(inner, ast.Constant) and type(inner.value) is int:
            return self.literal(-inner.value, node)  # INT64_MIN
        value = self.number(inner)
        if not minus:
            return value
        if value.kind == COMPLEX:
            self.not_translated(node)
        if value.kind == WHOLE:
            self._whole(node, ast.unparse(inner))
        if value.constant is not None and value.kind == INT:
            return self.literal(-value.constant, node)
        text = f'({value.text})' if value.text[0] == '-' else value.above(PRODUCT)
        constant = None if value.constant is None else -value.constant
        return value._replace(text=f'-{text}', level=UNARY, constant=constant, real='')

    def _whole(self, node: ast.AST, text: str) -> NoReturn:
        self.refuse(node, f'{text!r} is an int in Python: write float({text}) or int({text})')

    def _on_binary(self, node: ast.BinOp) -> Value:
        return self.arithmetic(node, node.op, self.number(node.left), self.number(node.right))

    def arithmetic(self, node: ast.AST, op: ast.operator, a: Value, b: Value) -> Value:
        """Return the result of an operator on two numbers."""
        flags, ints = self.in_order(node, a, b), a.kind == b.kind == INT
        if ints and a.constant is not None and b.constant is not None:
            made = ast.BinOp(ast.Constant(a.constant), op, ast.Constant(b.constant))
            made = ast.copy_location(made, node)
            return self.literal(
                self.sources.constant(Found(self.module, ast.unparse(made), made)), node
            )
        if COMPLEX in (a.kind, b.kind):
            name = OF_COMPLEX.get(type(op))
            if name is None:
                self.not_translated(node, ': complex numbers have +, - and *')
            return self.helper(name, COMPLEX, self.complex(a), self.complex(b))._replace(**flags)
        if isinstance(op, (ast.FloorDiv, ast.Mod)):
            if not ints:
                self.not_translated(node, ': // and % are for ints, use math.floor')
            name = 'floor_divide' if isinstance(op, ast.FloorDiv) else 'modulo'
            return self.helper(name, INT, a, b)._replace(**flags)
        if ints and type(op) in MASKS:
            text = f'{a.above(PRODUCT)} {MASKS[type(op)]} {b.above(PRODUCT)}'
            return Value(text, INT, BITS, **flags)
        if type(op) not in ARITHMETIC:
            self.not_translated(node, REMEDIES.get(type(op), ''))
        if FLOAT not in (a.kind, b.kind) and not ints:
            self._whole(node, ast.unparse(node))
        sign, level = ARITHMETIC[type(op)]
        if ints and sign == '/':
            return self.helper('divide', FLOAT, a, b)._replace(**flags)
        if not ints:
            a, b = (value._replace(text=value.real or value.text) for value in (a, b))
        text = f'{a.above(level - 1)} {sign} {b.above(level)}'
        return Value(text, INT if ints else FLOAT, level, **flags)

    def complex(self, value: Value) -> Value:
        """Return a number as a complex one."""
        zero = Value('0.0', FLOAT)
        return value if value.kind == COMPLEX else self.helper('complex_of', COMPLEX, value, zero)

    def helper(self, name: str, kind: Any, *values: Value) -> Value:
        """Return the call of a function of the prelude."""
        self.translator.helpers |= {name, 'Complex', 'complex_of'} if 'complex' in name else {name}
        return Value(f'{name}({", ".join(value.text for value in values)})', kind)

    @staticmethod
    def truth(value: Value) -> Value:
        """Return a bool as 0 or 1: C's isnan and its like may return any number."""
        test = value.text.split('(')[0] in TESTS
        return value._replace(text=f'(bool){value.text}', level=UNARY) if test else value

    def _on_compare(self, node: ast.Compare) -> Value:
        nodes = (node.left, *node.comparators)
        values = [self.one_of(item, (*k.VALUES, WHOLE), 'compared') for item in nodes]
        flags = self.in_order(node, *values)
        if any(value.writes for value in values[1:-1]):
            self.refuse(node, 'a chain would call it twice: assign it to a name first')
        pairs = [self._compared(node, op, *both) for op, *both in zip(node.ops, values, values[1:])]
        if all(pair.constant is not None for pair in pairs):
            return self.literal(all(pair.constant for pair in pairs), node)
        if len(pairs) == 1:
            return pairs[0]._replace(**flags)
        return Value(' && '.join(pair.above(AND) for pair in pairs), BOOL, AND, **flags)

    def _compared(self, node: ast.AST, op: ast.cmpop, a: Value, b: Value) -> Value:
        if type(op) not in COMPARISONS:
            self.not_translated(node)
        if COMPLEX in (a.kind, b.kind):
            if type(op) is not ast.Eq or BOOL in (a.kind, b.kind):
                self.not_translated(node, ': a complex number is equal to a number or not')
            return self.helper('complex_equal', BOOL, self.complex(a), self.complex(b))
        sign, level, compare = COMPARISONS[type(op)]
        for value, other in ((a, b), (b, a)):
            small = value.constant is not None and abs(value.constant) <= 2**53
            if value.kind == INT and other.kind in (FLOAT, WHOLE) and not small:
                self.refuse(
                    node, f'an int meets a float in {ast.unparse(node)!r}: write float(...)'
                )
        if (a.kind == BOOL) != (b.kind == BOOL) or (a.kind == BOOL and level == ORDER):
            self.not_translated(node, ': a bool is equal to a bool or not')
        if a.constant is not None and b.constant is not None:
            return self.literal(compare(a.constant, b.constant), node)
        if a.kind == BOOL:
            a, b = self.truth(a), self.truth(b)
        return Value(f'{a.above(ORDER)} {sign} {b.above(ORDER)}', BOOL, level)

    def _on_logic(self, node: ast.BoolOp) -> Value:
        """Return ``and`` or ``or`` of bools; what a constant decides is not translated."""
        both = isinstance(node.op, ast.And)
        values = []
        for item in node.values:
            value = self.condition(item)
            if value.constant is not both:  # neither True of `and` nor False of `or`
                values.append(value)
            if value.constant is (not both):
                break
        if len(values) < 2:
            return values[0] if values else self.literal(both, node)
        text = (' && ' if both else ' || ').join(value.above(AND) for value in values)
        reads, writes = any(v.reads for v in values), any(v.writes for v in values)
        return Value(text, BOOL, AND if both else OR, reads=reads, writes=writes)

    def _on_choice(self, node: ast.IfExp) -> Value:
        test = self.condition(node.test)
        if test.constant is not None:
            return self.expression(node.body if test.constant else node.orelse)
        a, b = self.expression(node.body), self.expression(node.orelse)
        if a.kind != b.kind:
            self.refuse(node, f'one of {a.kind} and {b.kind}: both must be of one type')
        if a.kind == INT:  # a literal alone is narrower in C
            if a.text.strip('-').isdigit() and b.text.strip('-').isdigit():
                a = a._replace(text=f'(int64_t){a.above(PRODUCT)}', level=UNARY)
        text = f'{test.above(TERNARY)} ? {a.address} : {b.address}'
        pointer, own = isinstance(a.kind, k.POINTERS), a.own and b.own
        reads, writes = test.reads or a.reads or b.reads, test.writes or a.writes or b.writes
        if pointer:
            return Value(f'({text})', a.kind, ATOM, None, reads, writes, pointer, own)
        return Value(text, a.kind, TERNARY, None, reads, writes)

    def _on_call(self, node: ast.Call) -> Value:
        """Return a call that has one number, or nothing, as its result."""
        func, name, called = node.func, ast.unparse(node.func), self.called(node)
        if called:
            function, arguments, flags = called
            if isinstance(function.returns, tuple):
                self.refuse(node, f'{name!r} returns several numbers: unpack them at once')
            return Value(f'{function.token}({", ".join(arguments)})', function.returns, **flags)
        found = self.lookup(func)
        if isinstance(found, Found) and isinstance(found.node, ast.FunctionDef):
            return Value('NAN', FLOAT)  # it is never reached, see `record.plain`
        if found is None and isinstance(func, ast.Attribute) and func.attr == 'take':
            return self._take(node, func.value)
        if node.keywords or isinstance(found, (Found, Module)):
            self.not_translated(node)
        values = [self.one_of(item, (*k.VALUES, WHOLE), 'a number') for item in node.args]
        if isinstance(found, Outside):
            made = self._math(node, found.name, values)
        else:
            made = self._builtin(node, name, values)
        return made._replace(**self.in_order(node, *values))

    def _take(self, node: ast.Call, owner: ast.expr) -> Value:
        to, of = self.expression(owner), [self.expression(item) for item in node.args]
        if not isinstance(to.kind, k.Record) or [to.kind] != [value.kind for value in of]:
            kinds = ', '.join(str(value.kind) for value in of)
            self.refuse(node, f'{to.kind} takes one {to.kind}, not {kinds}')
        self.in_order(node, to, *of)
        self.writes |= not to.own
        self.changed(owner)
        if self.translator.is_empty(to.kind):
            return Value('', k.NOTHING)
        text = ' = '.join(f'*{value.text}' if value.pointer else value.text for value in (to, *of))
        return Value(text, k.NOTHING, reads=True, writes=True)

    def _math(self, node: ast.Call, dotted: str, values: list[Value]) -> Value:
        name = dotted.removeprefix('math.')
        whole = name in ('floor', 'ceil')
        kinds = {value.kind for value in values}
        wrong = kinds != {FLOAT} if whole else kinds & {BOOL, COMPLEX}
        if name == dotted or name not in MATH or wrong:
            self.not_translated(node, ': no function of floats in math that C has too')
        if len(values) != MATH[name]:
            self.refuse(node, f'{name} takes {MATH[name]} floats')
        values = [self._builtin(node, 'float', [value]) for value in values]
        made = Value(f'{name}({", ".join(value.text for value in values)})', FLOAT)
        if whole:
            return self.helper('whole', WHOLE, made)
        return made._replace(kind=BOOL) if name in TESTS else made

    def _builtin(self, node: ast.Call, name: str, values: list[Value]) -> Value:
        kinds = {value.kind for value in values}
        if name == 'complex':
            if kinds != {FLOAT} or len(values) != 2:
                self.not_translated(node, ': give complex two floats')
            return self.helper('complex_of', COMPLEX, *values)
        if name == 'abs' and kinds == {COMPLEX} and len(values) == 1:
            return self.helper('complex_abs', FLOAT, *values)
        if COMPLEX in kinds:
            self.not_translated(node)
        if name in ('min', 'max') and len(values) > 1:
            if kinds not in ({FLOAT}, {INT}):
                self.not_translated(node, ': give it only floats, or only ints')
            helper = ('smaller' if name == 'min' else 'larger') + '_int' * (INT in kinds)
            made, *others = values
            for other in others:
                made = self.helper(helper, other.kind, made, other)
            return made
        if name not in ('abs', 'round', 'int', 'float', 'bool') or len(values) != 1:
            self.not_translated(node)
        (value,) = values
        kind = value.kind
        if kind == BOOL and name not in ('abs', 'round'):
            to = k.NUMBERS[name]
            text = f'({to.c}){self.truth(value).above(PRODUCT)}'
            return value if name == 'bool' else Value(text, to, UNARY)
        if name == 'bool':
            return Value(f'{value.above(ORDER)} != 0', BOOL, EQUAL)
        if name == 'float' and kind == INT and value.constant is not None:
            return self.literal(float(value.constant), node)
        if name == 'float' and kind == INT and not value.real:
            return Value(f'(double){value.above(PRODUCT)}', FLOAT, UNARY)
        if name == 'float':
            return value._replace(text=value.real or value.text, kind=FLOAT)
        if kind == INT:
            return self.helper('abs_int', INT, value) if name == 'abs' else value
        if name == 'int':
            return self.helper('to_int', INT, value)
        if kind != FLOAT:
            self.not_translated(node)
        if name == 'abs':
            return Value(f'fabs({value.text})', FLOAT)
        rounded = Value(f'rint({value.text})', FLOAT)
        real = self.helper('whole', FLOAT, rounded).text
        return self.helper('to_int', INT, rounded)._replace(real=real)

    def called(self, node: ast.AST | None) -> tuple[Any, list[str], dict[str, Any]] | None:
        """Return the function of ours that is called, its arguments, and what it reads; or None."""
        found = self.lookup(node.func) if isinstance(node, ast.Call) else None
        if not isinstance(found, Found) or not isinstance(found.node, ast.FunctionDef):
            return None
        if any(ast.unparse(mark) == 'plain' for mark in found.node.decorator_list):
            return None
        return self._arguments(node, found)  # type: ignore[arg-type]

    def _arguments(self, node: ast.Call, found: Found) -> tuple[Any, list[str], dict[str, Any]]:
        parameters = self.translator.parameters(found)
        pairs = [*zip(parameters, node.args), *((item.arg, item.value) for item in node.keywords)]
        nodes: dict[Any, ast.expr] = dict(pairs)
        reads = self.reads()
        values = {str(name): self.expression(item) for name, item in pairs}
        for name, (_, default) in parameters.items():
            if name not in values and default is not None:
                constant = self.sources.constant(Found(found.module, name, default))
                values[name] = self.literal(constant, node)
        fits = len(pairs) == len(node.args) + len(node.keywords) == len(dict(pairs))
        if not fits or set(values) != set(parameters):
            self.refuse(node, f'the call does not fit {found.name}({", ".join(parameters)})')
        static = {n: v.kind.module for n, v in values.items() if isinstance(v.kind, k.Static)}
        passed = {name: values[name] for name in parameters if name not in static}
        kinds = {name: value.kind for name, value in passed.items()}
        function = self.translator.function(found, static, kinds, self.module, node)
        self.unread(reads)
        for name in [*values]:
            if name in function.ignored:
                passed.pop(name, None)
            elif name in nodes:
                self.expression(nodes[name])  # read again
            if name in passed and (k.is_matrix(kinds[name]) or function.locals[name].written):
                self.changed(nodes[name])
        flags = self.in_order(node, *passed.values())
        pointers = [value for value in passed.values() if isinstance(value.kind, k.POINTERS)]
        self.writes |= function.writes and not all(value.own for value in pointers)
        flags['writes'] |= function.writes
        flags['reads'] |= bool(pointers)
        return function, [value.address for value in passed.values()], flags


METHODS: dict[type, Any] = {
    ast.Constant: Expressions._on_constant,
    ast.Name: Expressions._on_name,
    ast.Attribute: Expressions._on_attribute,
    ast.Subscript: Expressions._on_subscript,
    ast.UnaryOp: Expressions._on_unary,
    ast.BinOp: Expressions._on_binary,
    ast.Compare: Expressions._on_compare,
    ast.BoolOp: Expressions._on_logic,
    ast.IfExp: Expressions._on_choice,
    ast.Call: Expressions._on_call,
}
