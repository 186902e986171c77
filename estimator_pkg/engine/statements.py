# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""One function of the subset as C: its statements, its locals and its comments."""

import ast
import re
from collections.abc import Iterator, Mapping
from typing import Any

from . import kinds as k
from .expressions import ATOM, Expressions, Local, Value
from .kinds import BOOL, COMPLEX, FLOAT, INT, NOTHING, WHOLE
from .prelude import KEYWORDS
from .sources import Found, Module

ZEROS = {FLOAT: '0.0', WHOLE: '0.0', INT: '0', BOOL: 'false', COMPLEX: '{0.0, 0.0}'}
FIRST = 'assign its result to a name first'
Place = tuple[str, int, int]  # of an assignment: name, block, index in the block


class Function(Expressions):
    """A function, translated for the kinds of its arguments and for static modules."""

    def __init__(
        self,
        translator: Any,
        found: Found,
        static: dict[str, Module],
        kinds: Any,
        bound: Mapping[str, str],
    ) -> None:
        super().__init__(translator, found.module, static)
        self.bound = bound  # arguments that are constants of the file, and their names
        self.node, self.kinds, self.exported, self.token = found.node, kinds, '', ''
        self.returns: Any = None  # until it is translated
        self.lines: list[str] = []
        self.depth, self.block_id, self.index = 1, 0, 0
        self.top: list[Local] = []  # declared at the top
        self.marked: list[tuple[Local, bool]] = []  # of lines for one that is read, or not
        self.before: dict[Local, bool] = {}  # what was read before the assignment
        self.aliases: list[Local] = []  # pointers, perhaps to what is not changed
        self.ignored: set[str] = set()  # arguments that it does not read
        self.forwards: list[Any] = []  # functions whose several results it returns
        self.places: dict[str, list[tuple[dict[int, int], bool]]] = {}
        self._note_places(self.node.body, {})
        self.assigned = {n for n, at in self.places.items() if any(stored for _, stored in at)}
        self.declares = {place for name in self.assigned for place in self._declarations(name)}
        self.used = {*kinds, *self.assigned}  # names that C has in this function
        for name, kind in kinds.items():
            self.local(name, kind, pointer=isinstance(kind, k.POINTERS) and name not in bound)
            self.locals[name].text = bound.get(name, self.locals[name].text)
        returned = [node.value for node in ast.walk(self.node) if isinstance(node, ast.Return)]
        self.outputs: list[str] = []  # pointers through which several numbers are returned
        for items in zip(*(value.elts for value in returned if isinstance(value, ast.Tuple))):
            names = [getattr(item, 'id', getattr(item, 'attr', '')) for item in items]
            name = next(filter(None, names), f'result{len(self.outputs)}')
            self.outputs.append(self.fresh(f'{name}_out'))

    def translate(self) -> None:
        """Translate the body."""
        ended = self.block(self.node.body, self.node.lineno)
        self.returns = self.returns or NOTHING
        if self.returns != NOTHING and not ended:
            self.refuse(self.node, f'{self.node.name} does not return a value on every path')
        if self.lines[-1:] == ['    return;']:
            self.lines.pop()
        empty = self.translator.is_empty
        self.ignored = {  # arguments that are not passed
            name
            for name, kind in self.kinds.items()
            if empty(kind) or not (self.locals[name].read or name in self.assigned)
        }

    def name_results(self, targets: list[ast.expr]) -> None:
        """Name results that are expressions as the caller does."""
        for i, (target, name) in enumerate(zip(targets, self.outputs)):
            called = getattr(target, 'id', getattr(target, 'attr', '')).strip('_')
            if re.fullmatch(r'result\d_out_*', name) and called:
                self.outputs[i] = new = self.fresh(f'{called}_out')
                self.lines = [re.sub(rf'\b{name}\b', new, line) for line in self.lines]
        for function in self.forwards:
            function.name_results(targets)

    def text(self) -> str:
        """Return the function in C."""
        parameters = [
            self._constant(self.locals[name])
            + self.declaration(kind, self.locals[name].text, isinstance(kind, k.POINTERS))
            for name, kind in self.kinds.items()
            if name not in self.bound and (self.exported or name not in self.ignored)
        ]
        result = self.returns
        if isinstance(result, tuple):
            parameters += [f'{kind.c} *{name}' for kind, name in zip(result, self.outputs)]
            result = NOTHING
        doc = ast.get_docstring(self.node)
        prefix = 'static inline ' * bool(not self.exported or self.translator.prefix)
        lines = [comment(doc)] if doc else []
        lines += [f'{prefix}{result.c} {self.token}({", ".join(parameters) or "void"})', '{']
        lines += [f'    {local.kind.c} {local.text} = {ZEROS[local.kind]};' for local in self.top]
        arguments = [self.locals[name] for name in self.kinds if name not in self.ignored]
        arguments = [self.locals[name] for name in self.kinds] if self.exported else arguments
        arguments = [local for local in arguments if local.text not in self.bound.values()]
        lines += [f'    (void){local.text};' for local in (*arguments, *self.top) if not local.read]
        for line in self.lines:
            line = re.sub('\2(\\d+)\2', lambda i: self._constant(self.aliases[int(i[1])]), line)
            code, _, mark = line.partition('\0')
            local, wanted = self.marked[int(mark)] if mark else (None, True)
            if local is None or local.read == wanted:
                lines.append(code)
        return '\n'.join([*lines, '}'])

    # names --------------------------------------------------------------------------------------

    def declaration(self, kind: Any, name: str, pointer: bool = False) -> str:
        """Return the C declaration of a name."""
        return self.translator.declaration(kind, name, pointer)  # type: ignore[no-any-return]

    def _note_places(self, body: list[ast.stmt], around: dict[int, int]) -> None:
        """Note where each name is: the index of its statement in each block around it."""
        for i, node in enumerate(body):
            place = {**around, id(body): i}
            for inner in (getattr(node, 'body', None), getattr(node, 'orelse', None)):
                if isinstance(inner, list):
                    self._note_places(inner, place)
            for item in own_nodes(node):
                if isinstance(item, ast.Name):
                    stored = isinstance(item.ctx, ast.Store) and not isinstance(node, ast.AugAssign)
                    self.places.setdefault(item.id, []).append((place, stored))

    def _declarations(self, name: str) -> list[Place]:
        """Return the assignments that declare a name, [] where one at the top must.

        Each comes before all else of the name in its block, and one of them before each use.
        """
        places = [] if name in self.kinds else self.places[name]
        first: dict[int, int] = {}  # of a block: the assignment
        for place, stored in places:
            block, i = list(place.items())[-1]
            if stored and all(p.get(block, i + 1) > i or (p[block] == i and s) for p, s in places):
                first[block] = i
        found = []
        for place, _ in places:
            around = [(name, b, first[b]) for b, i in place.items() if i >= first.get(b, i + 1)]
            if not around:
                return []
            found.append(around[0])
        return found

    def fresh(self, name: str) -> str:
        """Return a name that C does not have in this function."""
        while name in self.used:
            name += '_'
        self.used.add(name)
        return name

    def local(self, name: str, kind: Any, pointer: bool = False, own: bool = False) -> Local:
        """Make a local of a name of the source."""
        text = self.fresh(name + '_') if name in KEYWORDS else name
        self.locals[name] = Local(text, kind, pointer, own)
        return self.locals[name]

    @staticmethod
    def _constant(local: Local) -> str:
        """Return 'const ' for a pointer to what is not changed."""
        of = getattr(local.kind, 'of', None)
        flat = isinstance(local.kind, k.Record) or isinstance(of, k.Kind)
        return 'const ' * (flat and not local.written)

    def _point(self, local: Local, reads: dict[Local, bool], *nodes: ast.AST) -> str:
        """Note where an alias comes from; return what stands for its const."""
        local.of = [root for node in nodes for root in self.roots(node)]
        self.unread(reads)
        self.aliases.append(local)
        if k.is_matrix(local.kind):
            local.write()
        return f'\2{len(self.aliases) - 1}\2'

    def _mark(self, local: Local, text: str, unless: bool = False) -> None:
        """Add a line if a local is read, or unless it is."""
        self.emit(f'{text}\0{len(self.marked)}')
        self.marked.append((local, not unless))

    # assignments --------------------------------------------------------------------------------

    def target(self, node: ast.expr, kind: Any) -> tuple[str, str]:
        """Return the target of a number in C, and its type where it is declared here."""
        declared = ''
        if isinstance(node, ast.Name):
            local = self.locals.get(node.id)
            old = local.kind if local else kind
            if (node.id, self.block_id, self.index) in self.declares:
                local, declared = self.local(node.id, kind), f'{kind.c} '
            elif local is None:
                local = self.local(node.id, kind)
                self.top.append(local)
            text = local.text
        elif isinstance(node, (ast.Attribute, ast.Subscript)) and first_name(node) in self.locals:
            value = self.expression(node)
            if value.writes:
                self.refuse(node, f'a call in a target changes a record: {FIRST}')
            self.writes |= not value.own
            self.changed(node.value)
            text, old = value.text, value.kind
        else:
            self.refuse(node, f'{ast.unparse(node)!r} cannot be assigned')
        if old != kind:
            remedy = {FLOAT: ': write float(...), or 0.0 for 0'}.get(old, '')
            remedy = ': use take' if isinstance(old, k.Record) else remedy
            self.refuse(node, f'{ast.unparse(node)!r} is {old} and cannot become {kind}{remedy}')
        return text, declared

    def _is_known(self, node: ast.Attribute, value: Value) -> bool:
        """Return True if a field's value is known at translation; refuse another one."""
        owner = self.expression(node.value).kind
        known = self.translator.known_value(owner, node.attr)
        if known is not None and value.constant != known:
            self.refuse(node, f'{ast.unparse(node)!r} is a constant of this header')
        return known is not None

    def assign(self, node: ast.expr, value: Value, source: ast.expr | None = None) -> str:
        """Assign a number, or give a record or vector a name; return the target in C."""
        if value.kind in ZEROS:
            if value.writes and reads_index(node):
                self.refuse(node, f'the call may change the index: {FIRST}')
            if isinstance(node, ast.Attribute) and self._is_known(node, value):
                return value.text
            text, declared = self.target(node, value.kind)
            self.emit(f'{declared}{text} = {value.text};')
        elif not isinstance(value.kind, (k.Record, k.Vector)) or value.constant:
            self.refuse(node, f'{value.kind} cannot be assigned')
        else:
            text = self._alias(node, value.kind, pointer=True, own=value.own)
            local = self.locals[node.id]  # type: ignore[attr-defined]
            constant = self._point(local, self.before, source or node)
            declared = constant + self.declaration(value.kind, text, pointer=True)
            if self.translator.is_empty(value.kind):
                return text
            self._mark(local, f'{declared} = {value.address};')
            return text
        if declared:
            local = self.locals[node.id]  # type: ignore[attr-defined]
            self._mark(local, f'(void){local.text};', unless=True)
        return text

    def _alias(self, node: ast.expr, kind: Any, pointer: bool, own: bool) -> str:
        """Return a new name of a record or vector."""
        if not isinstance(node, ast.Name):
            self.refuse(node, f'{ast.unparse(node)!r} is {kind}, which is not assigned: use take')
        if (node.id, self.block_id, self.index) not in self.declares:
            reason = f'{node.id!r} names a {kind}: assign it once, in a block with all its uses'
            self.refuse(node, reason)
        return self.local(node.id, kind, pointer, own).text

    def _on_assign(self, node: ast.Assign) -> None:
        targets, source, self.before = node.targets, node.value, self.reads()
        if isinstance(targets[0], ast.Tuple):
            called = self.called(source)
            if len(targets) == 1 and isinstance(source, ast.Tuple):
                self._tuple(node, targets[0].elts, source.elts)
            elif len(targets) == 1 and called:
                called[0].name_results(targets[0].elts)
                self._unpack(node, targets[0].elts, *called[:2])
            else:
                self.refuse(node, 'only a tuple, or a call of a function of ours, is unpacked')
        elif isinstance(source, ast.Call) and is_record(self.lookup(source.func)):
            self._make(node, source)
        else:
            value = self.expression(source)
            for target in targets:
                text = self.assign(target, value, source)
                if value.constant is None:
                    pointer = isinstance(value.kind, k.Record)
                    value = Value(text, value.kind, ATOM, pointer=pointer, own=value.own)

    def _make(self, node: ast.Assign, call: ast.Call) -> None:
        """Declare a record of this function, all zeros."""
        kind = self.translator.kinds.of(call.func, self.module, self.static)
        if kind is None or len(node.targets) > 1 or call.args or call.keywords:
            text = ast.unparse(call)
            self.refuse(node, f'{text!r}: a record of one name, without arguments and observer')
        text = self._alias(node.targets[0], kind, pointer=False, own=True)
        self.translator.helpers.add('ZERO')
        self.emit(f'{self.declaration(kind, text)} = ZERO;')

    def _tuple(self, node: ast.Assign, targets: list[ast.expr], items: list[ast.expr]) -> None:
        """Assign a tuple as if at once: what an earlier target changes is read before."""
        values = [self.expression(item) for item in items]
        if len(items) != len(targets) or any(value.writes for value in values):
            self.refuse(node, f'{ast.unparse(node)!r}: as many numbers as targets, without calls')
        for i, (item, value) in enumerate(zip(items, values)):
            if value.kind in ZEROS and any(clash(target, item) for target in targets[:i]):
                text = getattr(targets[i], 'id', getattr(targets[i], 'attr', f'item{i}'))
                text = self.fresh(f'{text}_next')
                self.emit(f'const {value.kind.c} {text} = {value.text};')
                values[i] = Value(text, value.kind)
        for target, value, item in zip(targets, values, items):
            self.assign(target, value, item)
        for item, value in zip(items, values):
            if value.kind in ZEROS:
                self.expression(item)  # read, whatever an alias forgot

    def _unpack(
        self, node: ast.Assign, targets: list[ast.expr], function: Any, arguments: list[str]
    ) -> None:
        """Call a function that returns several numbers, with pointers to the targets."""
        kinds = function.returns if isinstance(function.returns, tuple) else ()
        if len(kinds) != len(targets):
            name = function.node.name
            self.refuse(node, f'{name} returns {several(function.returns)}: unpack as many')
        for target, kind in zip(targets, kinds):
            if any(isinstance(item, ast.Subscript) for item in ast.walk(target)):
                self.refuse(target, 'an element is not unpacked into: assign it from a name')
            text, declared = self.target(target, kind)
            if declared and f'&{text}' not in arguments:  # `_` may be there twice
                self.emit(f'{declared}{text};')
            arguments.append(f'&{text}')
        self.emit(f'{function.token}({", ".join(arguments)});')

    def _on_augmented(self, node: ast.AugAssign) -> None:
        target: Any = node.target
        read = {name for name, local in self.locals.items() if local.read}
        old = self.number(type(target)(**{**vars(target), 'ctx': ast.Load()}))
        if isinstance(target, ast.Name):
            self.locals[target.id].read = target.id in read
        new = self.number(node.value)
        if new.writes:
            self.refuse(node, f'the call may change the target: {FIRST}')
        value = self.arithmetic(node, node.op, old, new)
        text, _ = self.target(target, value.kind)
        sign = {ast.Add: '+', ast.Sub: '-', ast.Mult: '*', ast.Div: '/'}.get(type(node.op))
        number = new.real if value.kind == FLOAT and new.real else new.text
        plain = sign and value.kind != COMPLEX
        self.emit(f'{text} {sign}= {number};' if plain else f'{text} = {value.text};')

    # control ------------------------------------------------------------------------------------

    def emit(self, text: str) -> None:
        """Add a line."""
        self.lines.append('    ' * self.depth + text)

    def block(self, body: list[ast.stmt], line: int) -> bool:
        """Translate statements and the comments from a line on; return whether they end it all."""
        for i, node in enumerate(body):
            method = STATEMENTS.get(type(node))
            if method is None:
                self.refuse(node, f'{type(node).__name__.lower()} is not translated')
            trailing, last = '', header_end(node)
            for number in range(line, last + 1):
                text, alone = self.module.comments.get(number, ('', True))
                if text and not alone and number == last:
                    trailing = f'  // {text}'
                elif text:
                    self.emit(f'// {text}')
            first, self.block_id, self.index = len(self.lines), id(body), i
            ended = method(self, node)
            at = [j for j in range(first, len(self.lines)) if '(void)' not in self.lines[j]]
            if trailing and at:
                j = at[0] if hasattr(node, 'body') else at[-1]
                code, mark, number_of_mark = self.lines[j].partition('\0')
                self.lines[j] = code + trailing + mark + number_of_mark
            line = (node.end_lineno or last) + 1
            if ended:
                return True
        return False

    def nested(self, body: list[ast.stmt], line: int) -> bool:
        """Translate an inner block."""
        self.depth += 1
        ended = self.block(body, line)
        self.depth -= 1
        return ended

    def _on_expression(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            text = self.expression(node.value).text
            if text:  # else a copy of constants
                self.emit(f'{text};')
        elif not isinstance(node.value, ast.Constant):  # a docstring
            self.refuse(node, f'{ast.unparse(node)!r} has no effect')

    def _on_pass(self, node: ast.Pass) -> None:
        """Write nothing."""

    def _on_jump(self, node: ast.Break | ast.Continue) -> bool:
        self.emit('break;' if isinstance(node, ast.Break) else 'continue;')
        return True

    def _on_return(self, node: ast.Return) -> bool:
        result, kind, called = node.value, NOTHING, self.called(node.value)
        if isinstance(result, ast.Tuple):
            kind = self._return_several(node, result.elts)  # type: ignore[assignment]
        elif called and isinstance(called[0].returns, tuple):
            function, arguments, _ = called
            kind = function.returns
            self.forwards.append(function)
            self.outputs = self.outputs or [self.fresh(name) for name in function.outputs]
            self.emit(f'{function.token}({", ".join([*arguments, *self.outputs])});')
            self.emit('return;')
        elif result is None or (isinstance(result, ast.Constant) and result.value is None):
            self.emit('return;')
        else:
            value = self.expression(result)
            kind = value.kind
            self.emit(f'return {value.text};')
        for one in kind if isinstance(kind, tuple) else (kind,):
            if one not in (*k.VALUES, NOTHING):
                self.refuse(node, f'{one} is not returned, only float, int, bool and complex')
        if self.returns not in (None, kind):
            was = several(self.returns)
            self.refuse(node, f'{self.node.name} returned {was} before and {several(kind)} here')
        self.returns = kind
        return True

    def _return_several(self, node: ast.Return, items: list[ast.expr]) -> tuple[Any, ...]:
        values = [self.expression(item) for item in items]
        if any(value.writes for value in values):
            self.refuse(node, f'a call changes a record: {FIRST}')
        for i, (name, value) in enumerate(zip(self.outputs, values)):
            if i and value.reads:  # where an output before it may point to
                text = self.fresh(name.replace('_out', '_now'))
                self.emit(f'const {value.kind.c} {text} = {value.text};')
                values[i] = value._replace(text=text)
        for name, value in zip(self.outputs, values):
            self.emit(f'*{name} = {value.text};')
        self.emit('return;')
        return tuple(value.kind for value in values)

    def _on_if(self, node: ast.If) -> bool:
        """Translate a branch; what a constant decides is not translated."""
        head, ends = 'if', []
        while True:
            test, rest = self.condition(node.test), node.orelse
            if test.constant is None:
                self.emit(f'{head} ({test.text}) {{')
                ends.append(self.nested(node.body, header_end(node) + 1))
                head = '} else if'
            else:
                rest = node.body if test.constant else node.orelse
                if head == 'if':
                    return self.block(rest, header_end(node) + 1)
            if len(rest) == 1 and isinstance(rest[0], ast.If):
                node = rest[0]
                continue
            if rest:
                self.emit('} else {')
                ends.append(self.nested(rest, rest[0].lineno))
            self.emit('}')
            return bool(rest) and all(ends)

    def _on_while(self, node: ast.While) -> bool:
        test = self.condition(node.test)
        if node.orelse:
            self.refuse(node, 'else of a loop is not translated')
        if test.constant is not False:
            self.emit(f'while ({test.text}) {{')
            self.nested(node.body, header_end(node) + 1)
            self.emit('}')
        return test.constant is True and not any(breaks(node.body))

    def _on_for(self, node: ast.For) -> None:
        each, name = node.iter, getattr(node.target, 'id', None)
        if node.orelse or name is None:
            self.refuse(node, 'a loop has one name, and no else')
        if isinstance(each, ast.Tuple) and each.elts:
            self._each(node, name, [self.expression(item) for item in each.elts])
        elif isinstance(each, ast.Call) and getattr(each.func, 'id', '') == 'range':
            self._range(node, name, each)
        else:
            self.refuse(node, 'a loop is over range(...) or over a tuple that is written there')
        self.nested(node.body, header_end(node) + 1)
        self.emit('}')

    def _range(self, node: ast.For, name: str, call: ast.Call) -> None:
        values = [self.expression(item) for item in call.args]
        if not 1 <= len(values) <= 3 or any(v.kind != INT or v.writes for v in values):
            self.refuse(node, 'range has one to three ints, and no call that changes a record')
        zero, one = self.literal(0, node), self.literal(1, node)
        first, last, step = [(zero, *values, one), (*values, one), values][len(values) - 1]
        if not step.constant:
            self.refuse(node, 'the step of range is a constant other than 0')
        end, bound = last.text, call.args[len(values) > 1]
        if last.constant is None and (not isinstance(bound, ast.Name) or bound.id in self.assigned):
            end = self.fresh(f'{name}_end')
            self.emit(f'const int64_t {end} = {last.text};')
        if self._own_loop(name):
            inner = count = self.local(name, INT).text
        else:
            inner, _ = self.target(node.target, INT)
            count = self.fresh(f'{name}_next')
        by = {1: '++', -1: '--'}.get(step.constant, f' += {step.text}')
        sign = '<' if step.constant > 0 else '>'
        self.emit(f'for (int64_t {count} = {first.text}; {count} {sign} {end}; {count}{by}) {{')
        if inner != count:
            self.emit(f'    {inner} = {count};')

    def _each(self, node: ast.For, name: str, values: list[Value]) -> None:
        kind, record = values[0].kind, isinstance(values[0].kind, k.Record)
        if any(v.kind != kind or v.writes for v in values) or not (record or kind in ZEROS):
            self.refuse(node, 'the items of a loop are numbers or records, all of one type')
        if not self._own_loop(name):
            self.refuse(node, f'{name!r} is used or assigned outside of loops over it')
        local = self.local(name, kind, pointer=record, own=all(v.own for v in values))
        constant = self._point(local, {}, *node.iter.elts)  # type: ignore[attr-defined]
        of = f'{constant}{self.translator.struct(kind)} *const' if record else f'const {kind.c}'
        index, items = self.fresh(f'{name}_index'), self.fresh(f'{name}_items')
        addresses = ', '.join(value.address for value in values)
        self.emit(f'{of} {items}[{len(values)}] = {{{addresses}}};')
        self.emit(f'for (int {index} = 0; {index} < {len(values)}; {index}++) {{')
        self.emit(f'    {of} {local.text} = {items}[{index}];')
        self._mark(local, f'(void){local.text};', unless=True)

    def _own_loop(self, name: str) -> bool:
        """Whether a name is only of loops over it and not assigned there: each may declare it."""
        loops = [item for item in ast.walk(self.node) if isinstance(item, ast.For)]
        bodies = [loop.body for loop in loops if getattr(loop.target, 'id', '') == name]
        inner = [item for body in bodies for node in body for item in ast.walk(node)]
        names = [item for item in inner if isinstance(item, ast.Name) and item.id == name]
        stored = any(isinstance(item.ctx, ast.Store) for item in names)
        count = len(names) + len(bodies)
        return name not in self.kinds and not stored and count == len(self.places[name])


def is_record(found: Any) -> bool:
    """Whether a name refers to a class."""
    return isinstance(found, Found) and isinstance(found.node, ast.ClassDef)


def header_end(node: Any) -> int:
    """Return the last line of a statement before the block in it."""
    header = getattr(node, 'iter', getattr(node, 'test', node))
    return int(header.end_lineno)


def own_nodes(node: ast.stmt) -> Iterator[ast.AST]:
    """Yield the nodes of a statement without those of the blocks in it."""
    for field, value in ast.iter_fields(node):
        for item in value if isinstance(value, list) else [value]:
            if field not in ('body', 'orelse') and isinstance(item, ast.AST):
                yield from ast.walk(item)


def first_name(node: Any) -> str:
    """Return the name that a field or an element begins with, '' where there is none."""
    while isinstance(node, (ast.Attribute, ast.Subscript)):
        node = node.value
    return getattr(node, 'id', '')


def reads_index(node: ast.AST) -> bool:
    """Whether an index in a target is read from a record or an array."""
    indices = [item.slice for item in ast.walk(node) if isinstance(item, ast.Subscript)]
    inner = [item for index in indices for item in ast.walk(index)]
    return any(isinstance(item, (ast.Attribute, ast.Subscript, ast.Call)) for item in inner)


def breaks(body: list[ast.stmt]) -> Iterator[bool]:
    """Yield True for each break that ends the loop with this body."""
    for node in body:
        if isinstance(node, ast.If):
            yield from breaks(node.body + node.orelse)
        elif isinstance(node, ast.Break):
            yield True


def clash(target: ast.expr, item: ast.expr) -> bool:
    """Whether an expression may read what is assigned to a target."""
    nodes = list(ast.walk(item))
    if isinstance(target, ast.Name):
        return any(isinstance(node, ast.Name) and node.id == target.id for node in nodes)
    if isinstance(target, ast.Attribute) and target.attr in [getattr(n, 'attr', '') for n in nodes]:
        return True
    element = ast.Subscript if isinstance(target, ast.Subscript) else ast.Call
    return any(isinstance(node, (ast.Call, element)) for node in nodes)


def several(kind: Any) -> str:
    """Return what a function returns, for an error."""
    return f'({", ".join(map(str, kind))})' if isinstance(kind, tuple) else str(kind)


def comment(text: str) -> str:
    """Return a block comment."""
    lines = text.replace('*/', '* /').rstrip().splitlines()
    if len(lines) == 1:
        return f'/* {lines[0]} */'
    return '\n'.join(['/* ' + lines[0], *(f' * {line}'.rstrip() for line in lines[1:]), ' */'])


STATEMENTS: dict[type, Any] = {
    ast.Expr: Function._on_expression,
    ast.Pass: Function._on_pass,
    ast.Assign: Function._on_assign,
    ast.AugAssign: Function._on_augmented,
    ast.Return: Function._on_return,
    ast.If: Function._on_if,
    ast.While: Function._on_while,
    ast.For: Function._on_for,
    ast.Break: Function._on_jump,
    ast.Continue: Function._on_jump,
}
