"""Compiled functions that a process need not trace where an earlier one has.

JAX's persistent cache keeps what XLA has made of a program, but finds it by the program itself, which Python traces and
lowers anew in every process: in a command that compiles nothing any more, the larger part of the wait. Where that cache
has a folder, the lowered programs of this package are kept there as well. One is found by what its trace depends on:
the function, the shapes of its arguments and all that is static in them, the source of this package, and the versions
and options of what else it goes through.
"""

from __future__ import annotations

import hashlib
import io
import os
import pickle
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property, wraps
from importlib.metadata import version
from pathlib import Path
from threading import RLock
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
from jax.core import Tracer
from jax.export import DisabledSafetyCheck, Exported, deserialize, export

_P = ParamSpec("_P")
_R = TypeVar("_R")

_TRACED = ("diffrax", "equinox", "jax", "jaxlib", "jaxtyping", "lineax", "numpy", "optimistix")
"""What a trace goes through beside this package. Their versions stand for their code."""

_KNOWN = {__name__.partition(".")[0], *_TRACED, *sys.stdlib_module_names}

# JAX promises some calls to later versions of itself, and would keep no others; here a program serves one version
_UNPROMISED = (DisabledSafetyCheck.custom_call("lapack_dormqr_ffi"),)


def compiled(
    function: Callable[_P, _R], by: Callable[[Callable[_P, _R]], Callable[_P, _R]] = eqx.filter_jit
) -> Callable[_P, _R]:
    """`eqx.filter_jit`, and kept between processes where JAX's persistent cache has a folder.

    Arrays are traced; all else in the arguments is static. Not kept is a call within another compiled function, on
    arrays that lie elsewhere than on the first device, with an argument whose code is not known here (an effect of
    one's own), or of a function that calls back to Python.

    Arguments:
        function: of a module or class: its name and this package's source stand for its code.
        by: what compiles a call that is not kept, with the same arguments static.
    """
    plain = by(function)
    programs: dict[Any, _Program | None] = {}
    lock = RLock()

    @wraps(function)
    def call(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        folder = _folder()
        if folder is None:
            return plain(*args, **kwargs)
        given = _Call(function, *jax.tree.flatten((args, kwargs)))
        if not _are_here(given.arrays):
            return plain(*args, **kwargs)
        kind = given.tree, tuple(_kind(leaf) for leaf in given.leaves)
        if kind not in programs:
            with lock:  # who comes second waits, and finds it
                if kind not in programs:
                    programs[kind] = _find(Path(folder, "wallid"), given)
        program = programs[kind]
        return plain(*args, **kwargs) if program is None else program(given.arrays)

    return call


class _Hole:
    """Where an array goes."""


@dataclass
class _Program:
    """A function of arrays alone, and what its answers are put into."""

    run: Callable[..., Sequence[jax.Array]]
    result: Any

    @classmethod
    def of(cls, exported: Exported, result: Any) -> _Program:
        """Of a lowered function."""

        def run(*arrays: Any) -> Any:
            return exported.call(*arrays)

        run.__name__ = run.__qualname__ = exported.fun_name
        return cls(jax.jit(run), result)

    def __call__(self, arrays: list[Any]) -> Any:
        answers = iter(self.run(*arrays))
        return jax.tree.map(lambda leaf: next(answers) if isinstance(leaf, _Hole) else leaf, self.result)


@dataclass
class _Call:
    """A function with its arguments taken apart."""

    function: Callable[..., Any]
    leaves: list[Any]
    tree: Any

    @cached_property
    def arrays(self) -> list[Any]:
        """Those among the leaves."""
        return [leaf for leaf in self.leaves if eqx.is_array(leaf)]

    def name(self) -> str:
        """The same in every process where the trace would be the same.

        Raises:
            pickle.PicklingError: what is static in the arguments has code that is not known here.
        """
        shapes = [_text(leaf) if eqx.is_array(leaf) else leaf for leaf in self.leaves]
        written = io.BytesIO()
        writer = _Writer(written, protocol=5)
        writer.fast = True  # what is equal is written alike, be it one object or two
        writer.dump((self.function.__module__, self.function.__qualname__, jax.tree.unflatten(self.tree, shapes)))
        return hashlib.sha256(written.getvalue() + _surroundings()).hexdigest()

    def lower(self) -> tuple[Exported, Any]:
        """The function of the arrays alone, and its result with holes for arrays.

        Raises:
            ValueError, NotImplementedError: it calls what cannot be kept.
        """
        results = []

        def flat(*arrays: Any) -> tuple[Any, ...]:
            given = iter(arrays)
            leaves = [next(given) if eqx.is_array(leaf) else leaf for leaf in self.leaves]
            args, kwargs = jax.tree.unflatten(self.tree, leaves)
            result = self.function(*args, **kwargs)
            results.append(jax.tree.map(lambda leaf: _Hole() if eqx.is_array(leaf) else leaf, result))
            # a program that is read back has lost its weak types: as a name depends on them, none has any
            return tuple(jax.lax.convert_element_type(a, a.dtype) for a in jax.tree.leaves(result) if eqx.is_array(a))

        flat.__name__ = flat.__qualname__ = self.function.__name__
        return export(jax.jit(flat), disabled_checks=_UNPROMISED)(*self.arrays), results[-1]


def _find(folder: Path, call: _Call) -> _Program | None:
    """The program that another process has left, or a new one, which is left for others; None where it cannot be."""
    try:
        path = folder / f"{call.function.__name__.strip('_')}-{call.name()}"
    except (pickle.PicklingError, TypeError, AttributeError):
        return None
    with suppress(Exception):  # of another pickle, cut short, forbidden: whatever it is, a new one is as good
        content, result = pickle.loads(path.read_bytes())
        return _Program.of(deserialize(bytearray(content)), result)
    try:
        exported, result = call.lower()
    except (ValueError, TypeError, NotImplementedError):  # the plain function says so itself where the fault is its own
        return None
    with suppress(OSError, pickle.PicklingError, TypeError, AttributeError):
        _write(path, pickle.dumps((bytes(exported.serialize()), result)))
    return _Program.of(exported, result)


def _write(path: Path, content: bytes) -> None:
    """Whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".") as beside:
        half = Path(beside, path.name)
        half.write_bytes(content)
        half.replace(path)


def _folder() -> str | None:
    """Of JAX's persistent cache, beside which programs are kept; None where there is none."""
    options: Any = jax.config  # what it has is not in its type
    named = options.jax_compilation_cache_dir
    if not named or not options.jax_enable_compilation_cache or options.jax_disable_jit:
        return None
    return named


def _are_here(arrays: list[Any]) -> bool:
    """Whether there are arrays, with values, and on the first device."""
    first = {jax.devices()[0]}
    return bool(arrays) and all(
        not isinstance(array, Tracer) and (not isinstance(array, jax.Array) or array.devices() == first)
        for array in arrays
    )


def _kind(leaf: Any) -> Any:
    """What a trace sees of an array; what is static with its type, as 1 == True."""
    return jax.typeof(leaf) if eqx.is_array(leaf) else (type(leaf), leaf)


def _text(array: Any) -> str:
    seen = jax.typeof(array)
    return f"{seen.dtype}{seen.shape}{' weak' if seen.weak_type else ''}"


class _Writer(pickle.Pickler):
    """Writes what has no code, or code that a version or our own source stands for."""

    def reducer_override(self, obj: Any) -> Any:
        """Refuse other code."""
        module = getattr(obj, "__module__", None) if callable(obj) else None
        if module is not None and module.partition(".")[0] not in _KNOWN:
            raise pickle.PicklingError(f"{obj!r} has code that is not known here")
        return NotImplemented


def _surroundings() -> bytes:
    """What a trace depends on beside its arguments."""
    # an attribute is what holds in a `with` block, too
    options = {name: getattr(jax.config, name, value) for name, value in jax.config.values.items()}
    options.pop("jax_compilation_cache_dir")
    flags = os.environ.get("XLA_FLAGS")  # `_xla` reads them
    return repr((_made_by(), jax.default_backend(), sorted(options.items()), flags)).encode()


@cache
def _made_by() -> tuple[str, ...]:
    """A digest of this package's source, and versions."""
    source = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        source.update(path.read_bytes())
    return source.hexdigest(), sys.version, *(version(name) for name in _TRACED)
