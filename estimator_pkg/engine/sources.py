# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""Modules as the translator reads them: syntax trees, comments and what a name refers to."""

import ast
import hashlib
import io
import math
import tokenize
from collections.abc import Mapping
from importlib.util import resolve_name
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

TRANSLATOR = 'entries expressions kinds prelude sources statements translate'
BUILTINS = {f.__name__: f for f in (abs, bool, float, int, len, max, min, range, round, sum, tuple)}


class RefusedError(Exception):
    """Something is not in the subset; the text is one line: ``file:line: reason``."""


class Imported(NamedTuple):
    """A name that an import statement binds; ``attribute`` is None for a module."""

    module: str
    attribute: str | None


class Outside(NamedTuple):
    """A name from a module that is not among the sources: ``math.sqrt``, ``numpy.float64``."""

    name: str


class Found(NamedTuple):
    """A function, a class or the expression of a constant, and the module that defines it."""

    module: 'Module'
    name: str
    node: Any


class Module:
    """One source file."""

    def __init__(self, name: str, path: Path, shown: str) -> None:
        self.name, self.shown, self.package = name, shown, path.name == '__init__.py'
        text = path.read_text('utf-8')
        try:
            tree = ast.parse(text)
        except SyntaxError as error:
            raise RefusedError(f'{shown}:{error.lineno}: {error.msg}') from None
        self.names: dict[str, Any] = {}
        self._define(tree.body)
        self.comments: dict[int, tuple[str, bool]] = {}  # of a line: text, and is it alone there
        for kind, token, (row, column), _, line in tokenize.generate_tokens(
            io.StringIO(text).readline
        ):
            comment = token.lstrip('#').strip().replace('??', '?').rstrip('\\')
            if kind == tokenize.COMMENT and not comment.startswith(('noqa', 'type:', 'fmt:')):
                self.comments[row] = comment, not line[:column].strip()

    @property
    def stem(self) -> str:
        """Short name for C: that of the folder where the file is only called observer."""
        parts = self.name.split('.')
        return parts[-2] if parts[-1] == 'observer' and len(parts) > 1 else parts[-1]

    @property
    def path(self) -> str:
        """The name by which `Sources.scope` finds it."""
        return self.name

    def refuse(self, node: Any, reason: str) -> NoReturn:
        """Raise `RefusedError` at a node."""
        raise RefusedError(f'{self.shown}:{node.lineno}: {reason}')

    def _define(self, body: list[ast.stmt]) -> None:
        for node in body:
            if isinstance(node, ast.Import):
                for alias in node.names:
                    name = alias.name if alias.asname else alias.name.split('.')[0]
                    self.names[alias.asname or name] = Imported(name, None)
            elif isinstance(node, ast.ImportFrom):
                package = self.name if self.package else self.name.rpartition('.')[0]
                module = resolve_name('.' * node.level + (node.module or ''), package)
                for alias in node.names:
                    self.names[alias.asname or alias.name] = Imported(module, alias.name)
            elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                self.names[node.name] = node
            elif isinstance(node, ast.If):  # TYPE_CHECKING
                self._define(node.body)
            elif isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value:
                for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                    self._define_constants(target, node.value)

    def _define_constants(self, target: ast.expr, value: ast.expr) -> None:
        """Keep the expression of a constant; of ``A, B = 1, 2`` an item of it."""
        if isinstance(target, ast.Name):  # one that is assigned twice has no value
            again = ast.copy_location(ast.Constant(None), value)
            self.names[target.id] = again if target.id in self.names else value
        elif isinstance(target, ast.Tuple):
            for i, item in enumerate(target.elts):
                one = ast.Subscript(value, ast.Constant(i), ast.Load())
                self._define_constants(
                    item, ast.fix_missing_locations(ast.copy_location(one, value))
                )


class Class(Module):
    """A class of static functions: what a name of it is, its bases and its file say."""

    def __init__(self, file: Module, node: ast.ClassDef) -> None:
        self.file, self.node, self.bases = file, node, node.bases
        self.name, self.shown, self.package, self.comments = (
            file.name,
            file.shown,
            False,
            file.comments,
        )
        self.names = {}
        self._define(node.body)

    @property
    def path(self) -> str:
        """The name by which `Sources.scope` finds it."""
        return f'{self.name}:{self.node.name}'


class Sources:
    """The modules below a root folder, and below those of other packages, each read once."""

    def __init__(self, root: Path, *others: Path) -> None:
        self.root, self._others = root, others
        self.modules: dict[str, Module | None] = {}
        self._constants: dict[ast.AST, Any] = {}
        self._classes: dict[ast.AST, Class] = {}

    def module(self, name: str) -> Module | None:
        """Return a module by its dotted name, None for one that is not below a root."""
        if name not in self.modules:
            file = '/'.join(name.split('.'))
            shown = (f'{file}.py', f'{file}/__init__.py')
            paths = ((root / each, each) for root in (self.root, *self._others) for each in shown)
            found = next((each for each in paths if each[0].is_file()), None)
            self.modules[name] = Module(name, *found) if found else None
        return self.modules[name]

    def read(self) -> list[str]:
        """Return the paths of all sources that were read, relative to the root."""
        return sorted({module.shown for module in self.modules.values() if module})

    def find(self, module: Module, name: str) -> Found | Module | Outside | None:
        """Return what a name of a module refers to, through any number of imports."""
        if isinstance(module, Class):
            return self.member(module, name) or self.find(module.file, name)
        item = module.names.get(name)
        if item is None:
            return self.module(f'{module.name}.{name}') if module.package else None
        if not isinstance(item, Imported):
            return Found(module, name, item)
        inner = self.module(item.module)
        if inner is None:
            return Outside('.'.join(filter(None, item)))
        if inner is module:  # a package that imports its own module
            return self.module(f'{inner.name}.{item.attribute}')
        return inner if item.attribute is None else self.find(inner, item.attribute)

    def member(self, scope: Class, name: str) -> Any:
        """Return what a class has or inherits by this name; None: nothing."""
        item = scope.names.get(name)
        if item is None:
            found = (self.dotted(scope.file, base, {}) for base in scope.bases)
            members = (self.member(base, name) for base in map(self.scope_of, found) if base)
            return next(filter(None, members), None)
        if isinstance(item, ast.Call) and ast.unparse(item.func) == 'staticmethod':
            return self.dotted(scope.file, item.args[0], {})
        return Found(scope, name, item)

    def scope_of(self, found: Any) -> Class | None:
        """Return a class as a scope; None for what is no class."""
        if not isinstance(found, Found) or not isinstance(found.node, ast.ClassDef):
            return None
        if found.node not in self._classes:
            self._classes[found.node] = Class(found.module, found.node)
        return self._classes[found.node]

    def scope(self, path: str) -> Module | None:
        """Return a module, or by ``module:Name`` a class; None: there is none."""
        name, _, inner = path.partition(':')
        module = self.module(name)
        return self.scope_of(self.find(module, inner)) if module and inner else module

    def dotted(self, module: Module, node: ast.AST, known: Mapping[str, Any]) -> Any:
        """Return what a dotted name refers to, first among ``known`` ones; None for a value."""
        if isinstance(node, ast.Name):
            return known[node.id] if node.id in known else self.find(module, node.id)
        if not isinstance(node, ast.Attribute):
            return None
        owner = self.dotted(module, node.value, known)
        if isinstance(owner, Outside):
            return Outside(f'{owner.name}.{node.attr}')
        owner = self.scope_of(owner) or owner
        if not isinstance(owner, Module):
            return None
        find: Any = self.member if isinstance(owner, Class) else self.find
        found = find(owner, node.attr)
        return found or module.refuse(node, f'{owner.shown} has no {node.attr!r}')

    def constant(self, found: Found) -> Any:
        """Return the value of a module's constant: a number, or a tuple of numbers."""
        module, name, node = found
        if node not in self._constants:
            tree = ast.fix_missing_locations(ast.Expression(node))
            try:
                value = eval(compile(tree, module.shown, 'eval'), _Names(self, module))
            except Exception as error:
                module.refuse(node, f'constant {name!r} has no value: {error}')
            items = value if isinstance(value, tuple) else (value,)
            if not items or any(type(item) not in (bool, int, float) for item in items):
                module.refuse(node, f'{name!r} is no number, no tuple of numbers, or set twice')
            self._constants[node] = value
        return self._constants[node]


class _Names(dict[str, Any]):
    """The constants of a module as names of an expression, or as attributes of the module."""

    def __init__(self, sources: Sources, module: Module) -> None:
        super().__init__(__builtins__=BUILTINS)
        self._sources, self._module = sources, module

    def __missing__(self, name: str) -> Any:
        found = self._sources.find(self._module, name)
        if isinstance(found, Module):
            return _Names(self._sources, found)
        if isinstance(found, Outside) and found.name.split('.')[0] == 'math':
            return getattr(math, found.name[5:]) if found.name != 'math' else math
        if isinstance(found, Found) and isinstance(found.node, ast.expr):
            return self._sources.constant(found)
        raise KeyError(name)

    def __getattr__(self, name: str) -> Any:
        return self[name]


def digest(root: Path, sources: list[str]) -> str:
    """Return a hash of the translator and of the sources, whose paths are relative to the root."""
    made = hashlib.sha256()
    own = [Path(__file__).with_name(f'{name}.py') for name in TRANSLATOR.split()]
    for path in (*own, *(root / name for name in sources)):
        made.update(path.name.encode() + b'\0' + path.read_bytes().replace(b'\r\n', b'\n') + b'\0')
    return made.hexdigest()
