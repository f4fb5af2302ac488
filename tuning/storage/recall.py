"""Parts that a study was begun with, found again wherever it is gone on with."""

from collections.abc import Sequence

from dualwinch.config.plugins import load_plugin
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.part import Part, registries
from dualwinch.tuning.storage.noted_parts import PartRecord, check_parts, part_record


def recall(study: str, parts: Sequence[PartRecord]) -> None:
    """Have the parts that a study was begun with registered, imported from where they were if nobody else gave them.

    Args:
        study: the study's name.
        parts: what was noted of them.

    Raises:
        ConfigurationError: a part is not there, or another one than it was.
    """
    for part in parts:
        if _registered(part) is None:
            _import(study, part)
    found = [(part, _registered(part)) for part in parts]
    check_parts(study, [part_record(known) for _, known in found if known is not None], parts)
    for part, known in found:
        if known is None:
            raise _missing(study, part, "it is defined there no more")


def _registered(part: PartRecord) -> type[Part] | None:
    found = next((registry for registry in registries() if registry.what == part["what"]), None)
    return found.get(part["kind"]) if found else None


def _import(study: str, part: PartRecord) -> None:
    if part["script"]:
        raise _missing(study, part, "that is a script, which is not run again for it")
    try:
        load_plugin(part["source"])
    except ConfigurationError as error:
        raise _missing(study, part, str(error)) from error


def _missing(study: str, part: PartRecord, reason: str) -> ConfigurationError:
    return ConfigurationError(
        f"--study {study}: needs the {part['what']} '{part['kind']}' of {part['source']}: {reason}; "
        "give the file that defines it, --plugin FILE"
    )
