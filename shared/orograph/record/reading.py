"""A record read again: its metadata and the protocol's messages, also where it was cut short."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader

from orograph import keys
from orograph.comms import wire
from orograph.errors import InputError
from orograph.messages import Message as RunMessage
from orograph.record.recorder import METADATA
from orograph.record.topics import RAW
from orograph.scenario import Scenario


@dataclass(frozen=True, eq=False)
class Told:
    """A message of the protocol at its time."""

    stamp_ns: int
    sender: str
    to: str
    message: RunMessage


@dataclass(frozen=True, eq=False)
class Record:
    """A run's scenario, its other metadata, and what its nodes told each other by radio, in order of time."""

    scenario: Scenario
    metadata: dict[str, str]
    told: tuple[Told, ...]
    whole: bool
    """False: the file was cut short, and this is what came before."""


def read_record(path: Path) -> Record:
    """What a file holds; raises InputError for one that is no record of ours."""
    metadata: dict[str, str] = {}
    channels: dict[int, Channel] = {}
    told, whole = [], True
    try:
        for record in _records(path):
            if record is None:
                whole = False
            elif isinstance(record, Metadata) and record.name == METADATA:
                metadata = dict(record.metadata)
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message) and channels[record.channel_id].message_encoding == RAW:
                told.append(_told(record, channels[record.channel_id].topic))
        if "scenario" not in metadata:
            raise InputError(f"{path}: no record of a run")
        scenario = Scenario.model_validate_json(metadata["scenario"])
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except (KeyError, ValueError) as error:
        raise InputError(f"{path}: a record of another version: {str(error).splitlines()[0]}") from None
    told.sort(key=lambda t: t.stamp_ns)
    return Record(scenario, metadata, tuple(told), whole)


def _records(path: Path) -> Iterator[object]:
    """All records of a file, and None at its end if that is not where it should be."""
    with path.open("rb") as stream:
        records = iter(StreamReader(stream).records)
        while True:
            try:
                record = next(records)
            except StopIteration:
                return
            except (McapError, EOFError):
                yield None
                return
            yield record


def _told(record: Message, topic: str) -> Told:
    _, to, name, sender = keys.parse_message_key(topic)
    return Told(record.log_time, sender, to, wire.decode(wire.kind_of(name), record.data))
