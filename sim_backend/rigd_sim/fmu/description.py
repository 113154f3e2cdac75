"""Reads an FMU file: whether it can be simulated here, and the variables that it has."""

from __future__ import annotations

import hashlib
import io
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rigd.model.machine.extras import is_installed, missing
from rigd_sim.fmu.units import FmuUnit, unit_of

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription, ModelVariable

#: Largest model description that is read, in bytes: that of a whole vehicle has 40 MB.
MAX_DESCRIPTION: Final = 200_000_000
#: Most bytes that the files of an FMU unpack to, which every run of it writes to a folder.
MAX_UNPACKED: Final = 4 << 30
#: Types whose values are numbers.
NUMBERS: Final = frozenset(
    [
        "Real",
        "Float64",
        "Float32",
        "Integer",
        "Boolean",
        "Enumeration",
        "Int8",
        "Int16",
        "Int32",
        "Int64",
        "UInt8",
        "UInt16",
        "UInt32",
        "UInt64",
    ]
)
#: Types whose numbers may have a unit.
_REAL: Final = frozenset({"Real", "Float64", "Float32"})


@dataclass(frozen=True)
class Variable:
    """A variable of an FMU, as its model description has it; numbers are the FMU's, not SI.

    ``unit_name`` is what the FMU calls its unit, ``unit`` that unit if it can be converted.
    """

    name: str
    reference: int
    kind: str
    causality: str
    variability: str
    settable: bool  #: whether it takes a value before it is initialised
    unit_name: str = ""
    unit: FmuUnit | None = None
    low: float | None = None
    high: float | None = None
    start: str | None = None
    doc: str = ""
    array: bool = False
    items: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class FmuFile:
    """An FMU of FMI 2 or 3 for co-simulation on this platform."""

    path: Path
    sha256: str
    version: str
    model: str
    identifier: str  #: name of its library
    token: str  #: GUID (FMI 2) or instantiation token (FMI 3)
    tool: str
    made: str
    fixed_step_s: float | None
    variables: Mapping[str, Variable]
    xml: str

    def names(self, *causalities: str) -> list[str]:
        """Return the names of its variables of these causalities."""
        return [item.name for item in self.variables.values() if item.causality in causalities]


def read_fmu(path: Path) -> FmuFile:
    """Return the FMU at ``path``; one that has not changed since is not read again.

    Raises:
        ValueError: it is no FMU, or cannot be simulated here; the message states why.
    """
    if not is_installed("fmu"):
        raise ValueError(missing("an FMU", "fmu"))
    try:
        status = path.stat()
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from error
    return _read(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=16)
def _read(path: Path, changed_ns: int, size: int) -> FmuFile:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from error
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            names = archive.namelist()
            if "modelDescription.xml" not in names:
                raise ValueError(f"{path.name} has no modelDescription.xml: it is no FMU")
            if archive.getinfo("modelDescription.xml").file_size > MAX_DESCRIPTION:
                raise ValueError(f"{path.name}: its modelDescription.xml is larger than 200 MB")
            if (unpacked := sum(item.file_size for item in archive.infolist())) > MAX_UNPACKED:
                raise ValueError(
                    f"{path.name} unpacks to {unpacked / 1e9:.3g} GB, at most "
                    f"{MAX_UNPACKED / 1e9:.3g} GB is unpacked; export it without what it "
                    "does not need"
                )
            xml = archive.read("modelDescription.xml").decode("utf-8", errors="replace")
    except zipfile.BadZipFile as error:
        raise ValueError(f"{path.name} is not a zip file, as every FMU is: {error}") from error
    found = re.search(r"<fmiModelDescription[^>]*?\sfmiVersion\s*=\s*[\"']([^\"']*)", xml)
    version = found[1] if found else "no stated version"
    if version[:2] not in ("2.", "3."):
        raise ValueError(f"{path.name} is of FMI {version}; rigd takes FMI 2 and 3: export it anew")
    description = _described(path, raw)
    slave = description.coSimulation
    if slave is None:
        has = [
            kind
            for kind, part in (
                ("model exchange", description.modelExchange),
                ("scheduled execution", description.scheduledExecution),
            )
            if part is not None
        ]
        raise ValueError(
            f"{path.name} is for {' and '.join(has) or 'nothing'} only; rigd needs co-simulation "
            "(CS): export it with a solver"
        )
    _check_platform(path, names, str(slave.modelIdentifier))
    step = slave.fixedInternalStepSize
    return FmuFile(
        path=path,
        sha256=hashlib.sha256(raw).hexdigest(),
        version=version,
        model=str(description.modelName),
        identifier=str(slave.modelIdentifier),
        token=str(description.instantiationToken),
        tool=description.generationTool or "not stated",
        made=description.generationDateAndTime or "not stated",
        fixed_step_s=None if step is None else float(step),
        variables=_variables(description),
        xml=xml,
    )


def _described(path: Path, raw: bytes) -> ModelDescription:
    import fmpy

    try:
        return fmpy.read_model_description(io.BytesIO(raw), validate=False)
    # fmpy raises what its parts raise: Exception itself, and errors of lxml, of Python and of zlib.
    except Exception as error:
        raise ValueError(
            f"{path.name}: its modelDescription.xml cannot be read: {error}"
        ) from error


def _check_platform(path: Path, names: list[str], identifier: str) -> None:
    """Check that the library for this platform is there (FMI 2.0.5, 2.3; FMI 3.0.2, 2.5.1.4)."""
    from fmpy import platform, platform_tuple, sharedLibraryExtension

    library = identifier + sharedLibraryExtension
    if any(f"binaries/{folder}/{library}" in names for folder in (platform, platform_tuple)):
        return
    has = sorted({name.split("/")[1] for name in names if name.startswith("binaries/")} - {""})
    raise ValueError(
        f"{path.name} has no binaries/{platform_tuple}/{library} (FMI 3) or "
        f"binaries/{platform}/{library} (FMI 2), for this machine; it has binaries for "
        f"{', '.join(has) or 'no platform'}"
    )


def _variables(description: ModelDescription) -> Mapping[str, Variable]:
    bases = {unit.name: unit.baseUnit for unit in description.unitDefinitions}
    return {item.name: _variable(item, bases) for item in description.modelVariables}


def _variable(item: ModelVariable, bases: Mapping[Any, Any]) -> Variable:
    declared = item.declaredType
    unit_name, kind = "", str(item.type)
    if kind in _REAL:
        unit_name = item.unit or (declared.unit if declared is not None else "") or ""
    low = item.min if item.min is not None else getattr(declared, "min", None)
    high = item.max if item.max is not None else getattr(declared, "max", None)
    causality, variability = str(item.causality), str(item.variability)
    is_start = item.initial in ("exact", "approx") and variability != "constant"
    return Variable(
        name=str(item.name),
        reference=int(item.valueReference),
        kind=kind,
        causality=causality,
        variability=variability,
        settable=is_start or causality == "input",
        unit_name=unit_name,
        unit=unit_of(unit_name, bases.get(unit_name)),
        low=_number(low),
        high=_number(high),
        start=item.start,
        doc=" ".join((item.description or "").split()),
        array=bool(item.dimensions),
        items={} if declared is None else {
            str(entry.name): int(entry.value) for entry in declared.items if entry.value
        },
    )  # fmt: skip


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None
