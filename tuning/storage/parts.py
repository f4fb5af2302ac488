"""Your own parts used by a study: recorded with it, and imported again when it is continued or joined."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, TypedDict

from dualwinch.config.plugins import load_plugin
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.part import Part, built_in, digest, named, registries, source_of


@dataclass(frozen=True)
class StudyName:
    """Name of a study in messages.

    Attributes:
        study: its name.
        file: of its storage; ``None``: it is in a database.
    """

    study: str
    file: Path | None = None

    def __str__(self) -> str:
        return f"--study {self.study}:" if self.file is None else f"{self.file}: study '{self.study}'"

    @property
    def another(self) -> str:
        """Advice in a message that it cannot be continued."""
        return "give another --study" if self.file is None else "give another --out or --study"


class PartRecord(TypedDict):
    """Record of a part.

    Attributes:
        what: such as ``position law``.
        kind: its name in files.
        source: path of the file, or name of the module, that defines it.
        script: whether that is a script, which cannot be imported without running it.
        sha256: of the source.
    """

    what: str
    kind: str
    source: str
    script: bool
    sha256: str


def part_records(*holders: Any) -> list[PartRecord]:
    """Records of all parts in given objects, except built-in ones.

    Raises:
        ConfigurationError: a part has no source by which it could be identified.
    """
    parts = {type(part) for holder in holders for part in _parts(holder)}
    return sorted(
        (part_record(part) for part in parts if not built_in(part)), key=lambda part: (part["what"], part["kind"])
    )


def part_record(part: type[Part]) -> PartRecord:
    """The record of a part.

    Raises:
        ConfigurationError: it has no source by which it could be identified.
    """
    sha256 = digest(part)
    if not sha256:
        raise ConfigurationError(f"{named(part)}: has no source to identify it by; define it in a file")
    return PartRecord(
        what=part.registry.what if part.registry else "part",
        kind=part.kind,
        source=source_of(part),
        script=part.__module__ == "__main__",
        sha256=sha256,
    )


def in_words(parts: Sequence[PartRecord]) -> str:
    """Records of parts in one line."""
    return "; ".join(
        f"{part['what']} '{part['kind']}' of {Path(part['source']).name}, sha256 {part['sha256']}" for part in parts
    )


def check_parts(study: StudyName, ours: Sequence[PartRecord], theirs: Sequence[PartRecord]) -> None:
    """Check that a study is not continued with a different part of the same kind as one recorded with it (`theirs`).

    Raises:
        ConfigurationError: a part's source differs.
    """
    records = {(part["what"], part["kind"]): part for part in theirs}
    for part in ours:
        record = records.get((part["what"], part["kind"]))
        if record and record["sha256"] != part["sha256"]:
            raise ConfigurationError(
                f"{study} was begun with another {part['what']} '{part['kind']}': the source {part['source']} "
                f"has sha256 {part['sha256'][:12]}, had {record['sha256'][:12]}; restore it, or {study.another}"
            )


def _parts(holder: Any) -> Iterator[Part]:
    """Every part in an object, including its fields, lists and tables."""
    if isinstance(holder, Part):
        yield holder
    if is_dataclass(holder) and not isinstance(holder, type):
        inner = [getattr(holder, field.name) for field in fields(holder)]
    elif isinstance(holder, Mapping):
        inner = list(holder.values())
    else:
        inner = holder if isinstance(holder, (tuple, list)) else ()
    for value in inner:
        yield from _parts(value)


def recall(study: StudyName, parts: Sequence[PartRecord]) -> list[str]:
    """Register the recorded parts of a study; those not registered yet are imported from their recorded source.

    Returns:
        The sources that were imported.

    Raises:
        ConfigurationError: a part is missing or differs.
    """
    imported = list[str]()
    for part in parts:
        if _registered(part) is None:
            _import(study, part)
            imported.append(part["source"])
    registered = [(part, _registered(part)) for part in parts]
    check_parts(study, [part_record(registration) for _, registration in registered if registration is not None], parts)
    for part, registration in registered:
        if registration is None:
            raise _missing(study, part, "it is no longer defined there")
    return imported


def _registered(part: PartRecord) -> type[Part] | None:
    registry = next((registry for registry in registries() if registry.what == part["what"]), None)
    return registry.get(part["kind"]) if registry else None


def _import(study: StudyName, part: PartRecord) -> None:
    if part["script"]:
        raise _missing(study, part, "that is a script, which is not run again for it")
    try:
        load_plugin(part["source"])
    except ConfigurationError as error:
        raise _missing(study, part, str(error)) from error


def _missing(study: StudyName, part: PartRecord, reason: str) -> ConfigurationError:
    return ConfigurationError(
        f"{study} needs the {part['what']} '{part['kind']}' of {part['source']}: {reason}; "
        "give the file that defines it, --plugin FILE"
    )
