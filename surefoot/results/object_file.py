"""Objects of the project in a file that holds values only: JSON and arrays, with a checksum.

Reading one runs no code of the file: a class must belong to the project or to a plug-in in use, and is restored without
its constructor. What one object refers to twice is one object again afterwards; arrays that share memory become separate.

Format: `MAGIC`, SHA-256 of all that follows, length of the JSON text (8 bytes, little endian), the JSON text, and the
contents of arrays one after the other. The JSON text has `nodes`, which refer to each other by {"node": index}, the
`blobs` (lengths of the contents), and the `root`.

Source: ours.
"""

from __future__ import annotations

import hashlib
import importlib
import itertools
import json
from array import array
from collections import deque
from collections.abc import Callable, Mapping
from enum import Enum
from pathlib import Path, PurePath
from typing import Any, Literal

import numpy as np

from perception.primitives import plugins
from perception.primitives.errors import InputError

MAGIC = b"surefoot objects 1\n"
PACKAGES = ("perception", "mapping", "planning", "sim", "surefoot")
"""Packages whose classes may be restored."""
_DIGEST = hashlib.sha256().digest_size
_LARGEST_INT = 2**256  # state of a random generator


def dumps(value: Any, given: Mapping[str, Any] | None = None) -> bytes:
    """The content of a file.

    Args:
        value: Numbers, text, containers, arrays, random generators, paths, and objects of the project's classes.
        given: Objects by name that are not stored: the reader supplies them.

    Raises:
        InputError: There is something else in it; the message names its class.
    """
    writer = _Writer(given or {})
    root = writer.value(value)
    header = {"nodes": writer.nodes, "blobs": [len(blob) for blob in writer.blobs], "root": root}
    text = json.dumps(header, separators=(",", ":")).encode()
    body = b"".join([len(text).to_bytes(8, "little"), text, *writer.blobs])
    return MAGIC + hashlib.sha256(body).digest() + body


def loads(content: bytes, given: Mapping[str, Any] | None = None) -> Any:
    """What `dumps` wrote.

    Args:
        content: Of the file.
        given: The objects that were not stored, by name; the file may hold no others of their classes.

    Raises:
        InputError: The content is damaged, of another format, or names a class that is not of the project.
    """
    start = len(MAGIC) + _DIGEST
    digest, body = content[len(MAGIC) : start], content[start:]
    if not content.startswith(MAGIC):
        raise InputError("it is not a file of this version of surefoot")
    if hashlib.sha256(body).digest() != digest:
        raise InputError("its checksum is wrong: the file is damaged")
    try:
        length = int.from_bytes(body[:8], "little")
        header = json.loads(body[8 : 8 + length])
        reader = _Reader(header["nodes"], _cut(body[8 + length :], header["blobs"]), given or {})
        return reader.value(header["root"])
    except InputError:
        raise
    except Exception as error:  # a forged file can name any class and any value
        raise InputError(f"its content is wrong ({type(error).__name__}: {error})") from error


def _cut(content: bytes, lengths: list[int]) -> list[bytes]:
    ends = np.cumsum([0, *lengths]).tolist()
    if ends[-1] != len(content) or min(lengths, default=0) < 0:
        raise InputError("its arrays are incomplete")
    return [content[a:b] for a, b in itertools.pairwise(ends)]


class _Writer:
    """Turns objects into nodes."""

    def __init__(self, given: Mapping[str, Any]) -> None:
        self.nodes: list[Any] = []
        self.blobs: list[bytes] = []
        self._given = {id(value): name for name, value in given.items()}
        self._known: dict[int, int] = {}
        self._kept: list[Any] = []  # so that no identity is used twice

    def value(self, value: Any) -> Any:
        """A value as it stands in a node: numbers and text themselves, all else by reference."""
        if value is None or type(value) in (bool, str):
            return value
        if type(value) is int and abs(value) < _LARGEST_INT:
            return value
        if type(value) is float:
            return value if np.isfinite(value) else {"float": str(value)}
        if id(value) in self._given:
            return {"given": self._given[id(value)]}
        if id(value) not in self._known:
            self._known[id(value)] = len(self.nodes)
            self._kept.append(value)
            self.nodes.append(None)
            self.nodes[self._known[id(value)]] = self._node(value)
        return {"node": self._known[id(value)]}

    def _node(self, value: Any) -> list[Any]:
        made = _WRITERS.get(type(value))
        if made is not None:
            return made(self, value)
        if isinstance(value, np.generic):
            return ["scalar", value.dtype.str, self.blob(value.tobytes())]
        if isinstance(value, PurePath):
            return ["path", str(value)]
        kind = type(value)
        name = f"{kind.__module__}:{kind.__qualname__}"
        if not _ours(kind.__module__) or isinstance(value, type):
            raise InputError(f"an object of class {name} cannot be kept in a file")
        if isinstance(value, Enum):
            return ["enum", name, value.name]
        if isinstance(value, tuple):
            return ["named", name, [self.value(item) for item in value]]
        state = value.__getstate__()
        return ["object", name, self.value(state)]

    def blob(self, content: bytes) -> int:
        """Keep the content of an array."""
        self.blobs.append(content)
        return len(self.blobs) - 1

    def values(self, values: Any) -> list[Any]:
        """The same of all values."""
        return [self.value(one) for one in values]


def _array_node(writer: _Writer, value: np.ndarray) -> list[Any]:
    if value.dtype.hasobject or value.dtype.names is not None:
        raise InputError(f"an array of type {value.dtype} cannot be kept in a file")
    order: Literal["F", "C"] = "F" if value.flags.fnc else "C"
    return ["array", value.dtype.str, value.shape, order, writer.blob(value.tobytes(order))]


def _generator_node(writer: _Writer, value: np.random.Generator) -> list[Any]:
    bits: Any = value.bit_generator
    if not isinstance(bits, np.random.PCG64):
        raise InputError(f"a generator of type {type(bits).__name__} cannot be kept in a file")
    seed: Any = bits.seed_seq
    return ["generator", writer.value(seed.state), writer.value(bits.state)]


_WRITERS: dict[type, Callable[[_Writer, Any], list[Any]]] = {
    int: lambda writer, value: _too_large(),
    list: lambda writer, value: ["list", writer.values(value)],
    tuple: lambda writer, value: ["tuple", writer.values(value)],
    set: lambda writer, value: ["set", writer.values(value)],
    frozenset: lambda writer, value: ["frozenset", writer.values(value)],
    deque: lambda writer, value: ["deque", writer.values(value), value.maxlen],
    dict: lambda writer, value: ["dict", [writer.values(item) for item in value.items()]],
    bytes: lambda writer, value: ["bytes", writer.blob(value)],
    array: lambda writer, value: ["typed", value.typecode, writer.blob(value.tobytes())],
    np.ndarray: _array_node,
    np.random.Generator: _generator_node,
}


def _too_large() -> list[Any]:
    raise InputError(f"an integer of more than {_LARGEST_INT.bit_length() - 1} bits cannot be kept")


class _Reader:
    """Turns nodes back into objects."""

    def __init__(self, nodes: list[Any], blobs: list[bytes], given: Mapping[str, Any]) -> None:
        self._nodes = nodes
        self._blobs = blobs
        self._given = given
        self._made: dict[int, Any] = {}

    def value(self, value: Any) -> Any:
        """The value of an entry of a node."""
        if not isinstance(value, dict):
            return value
        if "float" in value:
            return float(value["float"])
        if "given" in value:
            return self._given[value["given"]]
        index = value["node"]
        if index not in self._made:
            self._make(index)
        return self._made[index]

    def _make(self, index: int) -> None:
        """Restore a node. Containers and objects are entered before their content, which may refer to them."""
        kind, *rest = self._nodes[index]
        if kind == "object":
            self._object(index, *rest)
        elif kind in ("list", "dict", "set", "deque"):
            self._container(index, kind, *rest)
        else:
            self._made[index] = self._plain(kind, rest)

    def _plain(self, kind: str, rest: list[Any]) -> Any:
        if kind == "array":
            dtype, shape, order, blob = rest
            flat = np.frombuffer(self._blobs[blob], _dtype(dtype))
            return flat.reshape(shape, order=order).copy(order)
        if kind == "scalar":
            return np.frombuffer(self._blobs[rest[1]], _dtype(rest[0]))[0]
        if kind == "typed":
            made = array(rest[0])
            made.frombytes(self._blobs[rest[1]])
            return made
        if kind == "bytes":
            return self._blobs[rest[0]]
        if kind == "path":
            return Path(rest[0])
        if kind == "generator":
            return _generator(*map(self.value, rest))
        if kind == "enum":
            return _class(rest[0], Enum)[rest[1]]
        if kind == "named":
            return tuple.__new__(_class(rest[0], tuple), [self.value(one) for one in rest[1]])
        items = [self.value(one) for one in rest[0]]
        return {"tuple": tuple, "frozenset": frozenset}[kind](items)

    def _container(self, index: int, kind: str, items: list[Any], maxlen: Any = None) -> None:
        made: Any = {"list": list, "dict": dict, "set": set}.get(
            kind, lambda: deque(maxlen=maxlen)
        )()
        self._made[index] = made
        if kind == "dict":
            made.update((self.value(key), self.value(item)) for key, item in items)
        elif kind == "set":
            made.update(self.value(item) for item in items)
        else:
            made.extend(self.value(item) for item in items)

    def _object(self, index: int, name: str, state: Any) -> None:
        cls = _class(name, object)
        if cls in map(type, self._given.values()):
            raise InputError(f"it holds a {name}, which only the reader may supply")
        made = self._made[index] = cls.__new__(cls)
        found = self.value(state)
        if hasattr(cls, "__setstate__"):
            made.__setstate__(found)
            return
        parts = found if isinstance(found, tuple) else (found, None)
        for part in parts:
            for key, item in (part or {}).items():
                object.__setattr__(made, key, item)


def _ours(module: str) -> bool:
    """Whether objects of the classes of a module may be stored: the project's, and plug-ins that are in use."""
    return module.split(".")[0] in PACKAGES or plugins.holds(module)


def _class(name: str, kind: Any) -> Any:
    """A class of the project by "module:name"."""
    module, _, path = name.partition(":")
    if not _ours(module):
        raise InputError(f"it names {name}, which is not a class of surefoot")
    found: Any = importlib.import_module(module)
    for part in path.split("."):
        found = getattr(found, part)
    if not isinstance(found, type) or not issubclass(found, kind) or found.__module__ != module:
        raise InputError(f"it names {name}, which is not a class of surefoot")
    return found


def _dtype(name: str) -> np.dtype[Any]:
    dtype = np.dtype(name)
    if dtype.hasobject:
        raise InputError(f"it holds an array of type {name}")
    return dtype


def _generator(seed: dict[str, Any], state: Any) -> np.random.Generator:
    bits = np.random.PCG64(np.random.SeedSequence(**seed))
    bits.state = state
    return np.random.Generator(bits)
