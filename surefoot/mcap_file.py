"""MCAP files that survive a kill: a writer of topics, and a reader that needs no index.

Recordings and estimates are both written so. A reader starts at the head of the file, returns every complete message
of a truncated file, and skips damaged chunks.

Source: MCAP specification 0 (mcap.dev).
"""

from __future__ import annotations

import dataclasses
import io
import json
import os
import struct
from collections.abc import Callable, Iterator, Mapping
from io import BufferedReader
from pathlib import Path
from typing import Any, cast

import lz4.frame
import zstandard
from google.protobuf.message import DecodeError, Message
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, McapRecord, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from perception.primitives.errors import InputError, OutputError

MOST_CHUNK_BYTES = 1 << 28  # unpacked
MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")  # kind and length of a record
DAMAGE = (McapError, zstandard.ZstdError, struct.error, ValueError, DecodeError, KeyError)
"""Exceptions that the packages raise for damaged bytes."""
WRONG = (TypeError, IndexError, AttributeError, OverflowError, ZeroDivisionError, InputError)
"""Exceptions of content that is complete, but of another type or size than it should be."""


def nanoseconds(stamp_s: float) -> int:
    """Log time of a stamp; negative times, which MCAP cannot store, become zero."""
    return max(0, round(stamp_s * 1e9))


class TopicWriter:
    """Writes messages by topic: protobuf, or JSON with a schema.

    Args:
        path: File to write; an existing one is replaced.
        json_topics: JSON schema of every JSON topic; its title is the name of the schema.
        what: What the file is, for messages.
        keep: Length of the part of the existing file to go on after, as `length` gave it; 0: none.

    Raises:
        OutputError: The file cannot be written; every method may raise it.
    """

    def __init__(
        self,
        path: Path,
        json_topics: Mapping[str, Mapping[str, object]],
        what: str,
        keep: int = 0,
    ) -> None:
        self._path, self._json_topics, self._what = path, json_topics, what
        self._channels: dict[str, int] = {}
        place = path.with_name(f".part-{path.name}") if keep else path
        try:
            self._file = place.open("wb")
        except OSError as error:
            raise self._cannot_write(error) from error
        self._writer = cast(Any, Writer(self._file))  # the package is only partly typed
        self._do(self._writer.start, profile="", library="surefoot")
        if keep:
            self._do(self._copy, keep)
            self._do(os.replace, place, path)

    def metadata(self, name: str, values: Mapping[str, Any]) -> None:
        """Add named values, each as JSON, and pass them to the operating system."""
        data = {key: json.dumps(value) for key, value in values.items()}
        self._do(self._writer.add_metadata, name, data)
        self.flush()

    def add(self, topic: str, message: Message | dict[str, Any], log_time: int, group: int) -> None:
        """Append a message.

        Args:
            topic: A JSON topic for a dictionary.
            message: Content.
            log_time: Nanoseconds.
            group: Number of the group of messages that it belongs to; MCAP's sequence.
        """
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._register(topic, message)
        if isinstance(message, Message):
            data = message.SerializeToString()
        else:
            data = json.dumps(message, allow_nan=False, separators=(",", ":")).encode()
        self._do(self._writer.add_message, channel, log_time, data, log_time, group)

    def flush(self) -> None:
        """Close the chunk and pass it to the operating system."""
        self._do(self._writer.flush)

    def length(self) -> int:
        """Bytes written so far; closes the chunk."""
        self.flush()
        return self._file.tell()

    def close(self) -> None:
        """Write the index and close the file; a second call does nothing."""
        if self._file.closed:
            return
        try:
            self._do(self._writer.finish)
        finally:
            self._do(self._file.close)

    def _register(self, topic: str, message: Message | dict[str, Any]) -> int:
        if isinstance(message, Message):
            schema = register_schema(self._writer, type(message))
            return self._writer.register_channel(topic, MessageEncoding.Protobuf, schema)
        described = self._json_topics[topic]
        schema = self._writer.register_schema(
            str(described["title"]), SchemaEncoding.JSONSchema, json.dumps(described).encode()
        )
        return self._writer.register_channel(topic, MessageEncoding.JSON, schema)

    def _do(self, action: Callable[..., object], *given: Any, **named: Any) -> None:
        try:
            action(*given, **named)
        except OSError as error:
            raise self._cannot_write(error) from error

    def _cannot_write(self, error: OSError) -> OutputError:
        return OutputError(
            f"cannot write {self._what} {self._path}: {error.strerror or error}; "
            "choose another folder or free some space"
        )

    def _copy(self, length: int) -> None:
        """Write everything again that the first bytes of the file hold."""
        kept: Any = io.BytesIO(self._path.read_bytes()[:length])
        for record in records(io.BufferedReader(kept)):
            if isinstance(record, Schema):
                self._writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel):
                channel = self._writer.register_channel(
                    record.topic, record.message_encoding, record.schema_id
                )
                self._channels[record.topic] = channel
            elif isinstance(record, McapMessage):
                self._writer.add_message(
                    record.channel_id,
                    record.log_time,
                    record.data,
                    record.publish_time,
                    record.sequence,
                )
        self._writer.flush()


def messages(
    path: Path,
    damaged: Callable[[str, str], object] | None = None,
    grows: Callable[[], bool] | None = None,
) -> Iterator[tuple[str, McapMessage]]:
    """Topic and message of every complete message of a file.

    Args:
        path: The file.
        damaged: Told the number of a damaged chunk, and why it was skipped.
        grows: Of a file that is being written: asked at its end, waits, and returns whether more may come.
    """
    topics: dict[int, str] = {}
    with path.open("rb") as file:
        for record in records(file, damaged) if grows is None else _growing(file, grows):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, McapMessage):
                yield topics.get(record.channel_id, ""), record


def _growing(file: BufferedReader, grows: Callable[[], bool]) -> Iterator[McapRecord]:
    """The records of a file as they are written, until its footer or the end of its writer."""
    file.seek(len(MAGIC))
    more = True
    while more:
        more = grows()
        data, is_whole = _whole_records(file)
        if data:
            yield from records(io.BufferedReader(cast(Any, io.BytesIO(MAGIC + data))))
        more = more and not is_whole


def _whole_records(file: BufferedReader) -> tuple[bytes, bool]:
    """The complete records from the present place on, which moves behind them; and whether the last is the footer."""
    begin, data = file.tell(), file.read()
    end, code = 0, 0
    while end + RECORD_HEAD.size <= len(data) and code != Opcode.FOOTER:
        found, length = RECORD_HEAD.unpack_from(data, end)
        if end + RECORD_HEAD.size + length > len(data):
            break
        end, code = end + RECORD_HEAD.size + length, found
    file.seek(begin + end)
    return data[:end], code == Opcode.FOOTER


def _unpacked(chunk: Chunk) -> Chunk:
    """The same chunk without compression; ValueError if it is larger than `MOST_CHUNK_BYTES`."""
    size = chunk.uncompressed_size
    if chunk.compression == "zstd":
        size = max(size, zstandard.frame_content_size(chunk.data))
    if size > MOST_CHUNK_BYTES:
        raise ValueError(f"it unpacks to {size} bytes; {MOST_CHUNK_BYTES} are the most")
    if chunk.compression != "lz4":
        return chunk
    data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, MOST_CHUNK_BYTES)
    return dataclasses.replace(chunk, compression="", data=data)


def records(
    file: BufferedReader, damaged: Callable[[str, str], object] | None = None
) -> Iterator[McapRecord]:
    """All records up to the footer or the truncation, including those inside complete chunks."""
    reader = StreamReader(file, emit_chunks=True).records
    number = 0
    while True:
        try:
            record = next(reader, None)
        except (*DAMAGE, OverflowError, MemoryError):
            return  # the file ends inside this record
        if record is None or isinstance(record, Footer):
            return
        if not isinstance(record, Chunk):
            yield record
            continue
        number += 1
        try:
            inside = breakup_chunk(_unpacked(record), validate_crc=True)
        except (*DAMAGE, OverflowError, RuntimeError) as error:
            if damaged is not None and file.peek(1):  # else the chunk was being written at the end
                damaged(f"chunk {number}", f"damaged ({error})")
            continue
        yield from inside
