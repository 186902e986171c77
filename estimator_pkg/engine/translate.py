# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Functions of records as one file of C99, which is C++17 too.

`translate` reads the sources, follows calls and imports from the entry points, and writes each
function once for each static module and each kinds of arguments. What is not in the subset is a
`RefusedError` with file, line and reason.
"""

import ast
import re
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from . import kinds as k
from .expressions import number
from .prelude import HELPERS, KEYWORDS, TAKEN
from .sources import Found, Module, RefusedError, Sources, digest
from .statements import Function, comment

# Neither of the last two changes a number: floor and sqrt become instructions.
FLAGS = ['-O2', '-g0', '-std=c99', '-ffp-contract=off', '-fno-fast-math', '-fwrapv']
FLAGS += ['-fno-math-errno', '-fno-trapping-math']
FILE = """\
/* Made from Python functions by estimator_pkg/engine; do not edit. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

{body}

/* Hash of the sources and of the translator, paths of the sources, and of each entry point
 * its name, result and arguments: p a pointer, d double, q int64_t, ? bool. */
const char *velocity_estimator_digest(void) {{ return {digest}; }}
const char *velocity_estimator_sources(void) {{ return {sources}; }}
const char *velocity_estimator_functions(void) {{ return {functions}; }}

#ifdef __cplusplus
}}
#endif
"""


class Entry(NamedTuple):
    """A function to translate, the modules or classes of its static arguments, its name in C."""

    module: str
    function: str
    static: Mapping[str, str]
    name: str
    bound: Mapping[str, Any] = {}  # records that arguments are, constants of the text


Known = Mapping[tuple[str, str], Mapping[str, Any]]  # values of fields, by module and record


class Translator:
    """What the translation of some entry points has come to."""

    def __init__(
        self,
        root: Path,
        prefix: str = '',
        known: Known | None = None,
        used: set[tuple[str, str, str]] | None = None,
        others: Iterable[Path] = (),
    ) -> None:
        self.prefix, self._known, self.used = prefix, known or {}, used
        self.reached: set[tuple[str, str, str]] = set()  # module, record and field in use
        self._gains: dict[tuple[k.Record, str], tuple[str, str]] = {}
        self._records: dict[str, tuple[str, k.Record, Any]] = {}  # constants
        self.sources = Sources(root, *others)
        self.kinds = k.Kinds(self.sources)
        self.names: dict[tuple[str, str], str] = {}  # of records, by module and record
        self.helpers: set[str] = set()
        self.functions: dict[Any, Function] = {}  # each after what it calls
        self._structs: dict[k.Record, str] = {}
        self._constants: dict[ast.AST, tuple[str, str]] = {}
        self._names: list[list[str]] = []  # of each token, from short to long
        self._exported: list[str] = []  # name, result and arguments of each entry point

    def _token(self, module: Module, *choices: str) -> str:
        """Return a text that stands for one of these names until all names are known."""
        folder = '_'.join(module.name.split('.')[-2:])
        found = [*choices[:2], f'{folder}_{choices[0]}', *choices[2:]]
        self._names.append([self._prefixed(name) for name in found])
        return f'\1{len(self._names) - 1}\1'

    def _prefixed(self, name: str) -> str:
        """Return a name of the file with the header's prefix, in the style of the name."""
        if not self.prefix:
            return name
        if name.isupper():
            return f'{self.prefix.upper()}_{name}'
        return f'{self.prefix}_{name}' if name.islower() else f'{camel(self.prefix)}{name}'

    def known_value(self, record: Any, field: str) -> Any:
        """Return the value that all records of a class have in a field; None: not known."""
        if not self._known or not isinstance(record, k.Record):
            return None
        return self._known.get((record.module.name, record.node.name), {}).get(field)

    def is_empty(self, kind: Any) -> bool:
        """Whether the values of all fields of a record are known."""
        return (
            bool(self.prefix)
            and isinstance(kind, k.Record)
            and all(
                self.known_value(kind, name) is not None
                or (self.used is not None and field(kind, name) not in self.used)
                or self.is_empty(inner)
                for name, inner in self.kinds.fields(kind).items()
            )
        )

    def gain(self, record: k.Record, name: str, value: Any, kind: Any) -> str:
        """Return the token of a constant whose value is that of a field."""
        if (record, name) not in self._gains:
            owner, upper = record.node.name.upper(), name.upper()
            token = self._token(record.module, upper, f'{owner}_{upper}')
            (node,) = (item for item in record.declared if item.target.id == name)
            note = record.module.comments.get(node.end_lineno, ('', True))[0]
            source = f'static const {self.declaration(kind, token)} = {constant_text(value)};'
            self._gains[record, name] = token, source + (f'  // {note}' if note else '')
        return self._gains[record, name][0]

    def parameters(self, found: Found) -> dict[str, tuple[ast.expr | None, ast.expr | None]]:
        """Return annotation and default of each parameter of a function."""
        node = found.node.args
        marks = [ast.unparse(mark) for mark in found.node.decorator_list]
        if marks not in ([], ['staticmethod']) or node.vararg or node.kwarg:
            found.module.refuse(found.node, f'{found.name} has a decorator, * or **')
        items = (*node.posonlyargs, *node.args, *node.kwonlyargs)
        defaults = [*node.defaults, *node.kw_defaults]
        defaults = [None] * (len(items) - len(defaults)) + defaults
        return {item.arg: (item.annotation, value) for item, value in zip(items, defaults)}

    def annotated(self, found: Found, static: Mapping[str, Module]) -> dict[str, Any]:
        """Return the kind that each annotation says, or None, but of static modules."""
        annotations = {n: a for n, (a, _) in self.parameters(found).items() if n not in static}
        return {n: a and self.kinds.of(a, found.module, static) for n, a in annotations.items()}

    def function(
        self,
        found: Found,
        static: dict[str, Module],
        kinds: dict[str, Any],
        module: Module,
        at: Any,
        bound: Mapping[str, str] | None = None,
    ) -> Function:
        """Return a function for static modules and kinds of arguments, which ``at`` calls."""
        for name, expected in self.annotated(found, static).items():
            kind = kinds[name]
            row = isinstance(expected, k.Array) and getattr(kind, 'of', None) == expected.of
            if expected not in (None, kind) and not (row and isinstance(kind.of, k.Kind)):
                remedy = ': write float(...), or 0.0 for 0' if expected == k.FLOAT else ''
                reason = f'{name!r} of {found.name} is {expected} and cannot be {kind}{remedy}'
                module.refuse(at, reason)
        key = found.node, *static.items(), *kinds.items()
        if key not in self.functions:
            function = self.functions[key] = Function(self, found, static, kinds, bound or {})
            function.token = self._token(found.module, *self._choices(found, static, kinds))
            function.translate()
            self.functions[key] = self.functions.pop(key)
        elif self.functions[key].returns is None:
            module.refuse(at, f'{found.name} calls itself, which is not translated')
        return self.functions[key]

    def _choices(self, found: Found, static: dict[str, Module], kinds: dict[str, Any]) -> list[str]:
        """Return names for a function: by its module, by its observer, by its arguments."""
        observers = [getattr(kind, 'observer', None) for kind in kinds.values()]
        modules = dict.fromkeys(module for module in (*static.values(), *observers) if module)
        stems = () if self.prefix else (module.stem for module in modules)
        name = '_'.join([*stems, found.name.lstrip('_')])
        longer = f'{found.module.stem}_{name}' + '_' * found.name.startswith('_')
        of = dict.fromkeys(re.sub(r'\W+', '_', str(kind)) for kind in kinds.values())
        return [name, longer, '_'.join([longer, *of])]

    def declaration(self, kind: Any, name: str, pointer: bool = False) -> str:
        """Return the C declaration of a name."""
        if isinstance(kind, k.Array) or (pointer and isinstance(kind, k.Vector)):
            records = isinstance(kind, k.Array) and isinstance(kind.of, k.Record)
            name = f'(*{name})' if isinstance(kind.of, k.Vector) else '*' * (1 + records) + name
            kind = kind.of
        elif pointer:
            name = f'*{name}'
        while isinstance(kind, k.Vector):
            name, kind = f'{name}[{kind.count}]', kind.of
        self.helpers |= {'Complex'} if kind == k.COMPLEX else set()
        return f'{self.struct(kind) if isinstance(kind, k.Record) else kind.c} {name}'

    def struct(self, record: k.Record) -> str:
        """Return the token of a record's name in C."""
        if record not in self._structs:
            node, module = record.node, record.module
            name = node.name
            fixed = self.names.get((module.name, name))
            if record.observer and not self.prefix:
                name = camel(record.observer.stem) + name
            token = fixed or self._token(module, name, camel(module.stem) + name)
            for inner in self.kinds.fields(record).values():
                self.declaration(inner, '')  # its records come before
            self._structs[record] = token
        return self._structs[record]

    def _struct_text(self, record: k.Record, token: str) -> str:
        """Return the declaration of a record in C."""
        node, module = record.node, record.module
        lines = [comment(ast.get_docstring(node) or node.name), 'typedef struct {']
        for field in self._fields(record):
            name = field.target.id
            note = module.comments.get(field.end_lineno, ('', True))[0]
            text = self.declaration(
                self.kinds.fields(record)[name], name + '_' * (name in KEYWORDS)
            )
            if self.prefix and not re.fullmatch(r'.*_ns|t\d', name):  # counts, no times
                text = text.replace('int64_t', 'int32_t')
            lines.append(f'    {text};' + (f'  // {note}' if note else ''))
        return '\n'.join([*lines, f'}} {token};'])

    def constant(self, found: Found, value: Any, kind: Any) -> str:
        """Return the token of a constant of a module."""
        module, name, node = found
        if node not in self._constants:
            name = name.strip('_')
            token = self._token(module, name, f'{module.stem.upper()}_{name}')
            note, alone = module.comments.get(node.end_lineno, ('', True))
            notes = [] if isinstance(node, (ast.Constant, ast.Tuple)) else [ast.unparse(node)]
            notes += [] if alone else [note]
            source = f'static const {self.declaration(kind, token)} = {constant_text(value)};'
            self._constants[node] = (
                token,
                '  // '.join([source, '; '.join(notes)][: 1 + bool(notes)]),
            )
        return self._constants[node][0]

    def _bind(self, name: str, kind: k.Record, item: Any) -> str:
        """Return the token of a record that is a constant of the text."""
        if name not in self._records:
            self._records[name] = self._token(kind.module, name.upper()), kind, item
        return self._records[name][0]

    def _fields(self, record: k.Record) -> list[Any]:
        """Return the declarations of the fields that a record has in C."""
        kinds = self.kinds.fields(record)
        return [
            node
            for node in record.declared
            if not self.prefix
            or (
                field(record, node.target.id) in (self.used or self.reached)
                and not self.is_empty(kinds[node.target.id])
            )
        ]

    def _record_text(self, kind: Any, value: Any) -> str:
        """Return a value, of a record or of one of its fields, as C initialises it."""
        if isinstance(kind, k.Vector):
            return f'{{{", ".join(self._record_text(kind.of, item) for item in value)}}}'
        if not isinstance(kind, k.Record):
            return number(value)
        names, kinds = [node.target.id for node in self._fields(kind)], self.kinds.fields(kind)
        items = [self._record_text(kinds[name], getattr(value, name)) for name in names]
        return f'{{{", ".join(items)}}}'

    def export(self, entry: Entry) -> None:
        """Translate an entry point."""
        module = self.sources.module(entry.module)
        found = module and self.sources.find(module, entry.function)
        if not isinstance(found, Found) or not isinstance(found.node, ast.FunctionDef):
            raise RefusedError(f'{entry.module}:1: there is no function {entry.function!r}')
        static: dict[str, Any] = {n: self.sources.scope(d) for n, d in entry.static.items()}
        for name, module in static.items():
            if module is None or name not in self.parameters(found):
                found.module.refuse(found.node, f'no argument {name!r}, or no module for it')
        kinds = self.annotated(found, static)
        for name, kind in kinds.items():
            if kind is None:
                reason = f'annotate {name!r} of the entry point {found.name}, or make it static'
                found.module.refuse(found.node, reason)
        bound = {name: self._bind(name, kinds[name], item) for name, item in entry.bound.items()}
        function = self.function(found, static, kinds, found.module, found.node, bound)
        if k.COMPLEX in (*kinds.values(), function.returns):
            reason = f'the entry point {found.name} takes or returns complex: use a record'
            found.module.refuse(found.node, reason)
        if function.exported:
            found.module.refuse(found.node, f'{found.name} is exported as {function.exported!r}')
        function.exported = entry.name
        several = function.returns if isinstance(function.returns, tuple) else ()
        codes = [getattr(kind, 'code', 'p') for kind in kinds.values()] + ['p' for _ in several]
        result = '' if several else function.returns.code
        self._exported.append(f'{entry.name}:{result}:{"".join(codes)}')

    def body(self) -> str:
        """Return records, constants and functions as C."""
        functions = [function.text() for function in self.functions.values()]
        structs = [
            (token, self._struct_text(record, token)) for record, token in self._structs.items()
        ]
        records = [
            (token, f'static const {self.struct(kind)} {token} = {self._record_text(kind, item)};')
            for token, kind, item in self._records.values()
        ]
        used = '\n'.join(functions)
        for some in (records, structs[::-1]):  # what the rest uses
            for token, text in some:
                used += text * (token in used)
        gains, constants, kept, types = (
            [text for token, text in some if token in used]
            for some in (self._gains.values(), self._constants.values(), records, structs)
        )
        parts = [text for name, text in HELPERS.items() if name in self.helpers]
        parts += [*types, '\n'.join(gains), '\n'.join(kept), '\n'.join(constants)]
        names = self._resolved()
        body = '\n\n'.join(filter(None, (*parts, *functions)))
        body = re.sub('\1(\\d+)\1', lambda i: names[int(i[1])], body)
        if self.prefix:
            calls = '|'.join(self.helpers)
            ours = rf'\b({calls})\b(?=\()|\b(?<== )ZERO\b|(?<=define )ZERO\b|\bComplex\b(?=[; ])'
            body = re.sub(ours, lambda i: self._prefixed(i[0]), body)
        return '\n'.join(line for long in body.splitlines() for line in wrapped(long))

    def text(self) -> str:
        """Return all that was translated as C, with what `load` needs."""
        body = self.body()
        read = self.sources.read()
        lists = [digest(self.sources.root, read)], read, self._exported
        texts = ['\n        '.join([f'"{line} "' for line in lines] or ['""']) for lines in lists]
        return FILE.format(body=body, digest=texts[0], sources=texts[1], functions=texts[2])

    def _resolved(self) -> list[str]:
        """Return a name for each token: the shortest that nothing else has."""
        functions = self.functions.values()
        fixed = {int(f.token.strip('\1')): f.exported for f in functions if f.exported}
        helpers = (self._prefixed(name) for name in HELPERS)
        taken = TAKEN.union(self.names.values(), helpers).union(
            *(function.used for function in functions)
        )
        level = [0] * len(self._names)
        while True:
            names = [
                fixed.get(i) or (choices[at] if at < len(choices) else f'{choices[-1]}_{i}')
                for i, (choices, at) in enumerate(zip(self._names, level))
            ]
            again = [
                i
                for i, name in enumerate(names)
                if i not in fixed and (name in taken or names.count(name) > 1)
            ]
            if not again:
                return names
            for i in again:
                level[i] += 1


def translate(entries: Iterable[Entry], root: Path) -> str:
    """Return the C99 text of entry points and of all that they call.

    Raises
    ------
    RefusedError : something is not in the subset; one line with file, line and reason.
    """
    translator = Translator(root)
    for entry in entries:
        translator.export(Entry(*entry))
    return translator.text()


def field(record: k.Record, name: str) -> tuple[str, str, str]:
    """Return what names a field of a record."""
    return record.module.name, record.node.name, name


def constant_text(value: Any) -> str:
    """Return a number, a vector or a matrix in C."""
    if isinstance(value, (tuple, list)):
        return f'{{{", ".join(map(constant_text, value))}}}'
    return number(value)


def camel(name: str) -> str:
    """Return a name as the beginning of a record's."""
    return ''.join(part.capitalize() for part in name.split('_'))


def wrapped(line: str) -> list[str]:
    """Return a line of C in lines of at most 100 columns; a comment beside it goes above."""
    if len(line) <= 100 or line.lstrip().startswith(('//', '/*', '*')):
        return [line]
    pad = line[: len(line) - len(line.lstrip())]
    code, mark, note = line.strip().partition('  // ')
    code = re.sub(r'(\w) (\*?\w)', '\\1\1\\2', code)  # a type stays beside its name
    whole: dict[str, Any] = {'break_long_words': False, 'break_on_hyphens': False}
    parts = textwrap.wrap(code, 98, initial_indent=pad, subsequent_indent=pad + ' ' * 8, **whole)
    return [f'{pad}// {note}'] * bool(mark) + [part.replace('\1', ' ') for part in parts]
