"""Defines the schema of a map of ``rigd import``: the keys and values that are allowed."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from annotated_types import Ge, Le
from pydantic import Field, StringConstraints

from rigd.config.schema import file_schema
from rigd.config.source import ChannelName, DerivedSource, FileName, Name, QuantityText, Source
from rigd.procedure.source import IdentifySource, OneOrMore, UnitText

#: The name of a column in a file: with or without its unit, or its number from 1.
ColumnText = Annotated[str, StringConstraints(min_length=1, max_length=200)]
#: The names of files: `*` stands for any text, `{name}` for a text that is kept under that name.
PatternText = Annotated[str, StringConstraints(min_length=1, max_length=300)]
#: A day and time as 2016-03-04T10:00:00Z; without a zone it is UTC.
MomentText = Annotated[str, StringConstraints(min_length=8, max_length=40)]
LineNumber = Annotated[int, Ge(0), Le(100_000)]
Format = Literal["csv", "parquet", "hdf5", "mat", "tdms", "mdf", "numpy", "jsonl"]


class TextTableSource(Source):
    """How a text file is written; what is not given is read off its first lines."""

    separator: Literal[",", ";", "tab", "|", "space"] | None = None
    """What stands between two cells; by default a tab, a semicolon or a comma, the first of these
    that the line of the names has.
    """
    decimal: Literal[".", ","] = "."
    """The decimal sign."""
    encoding: Annotated[str, StringConstraints(min_length=1, max_length=40)] = "utf-8"
    """The encoding of the text, such as `latin-1` or `utf-16`."""
    header: LineNumber = 1
    """The line with the names of the columns; 0 if there is none: columns go by their numbers."""
    units: LineNumber = 0
    """The line with the units of the columns; 0 if there is none."""
    first: LineNumber = 0
    """The first line of data; by default the one after names and units."""
    last: LineNumber = 0
    """The last line of data, as in a file with several tables; by default that of the file."""
    missing: Annotated[list[Annotated[str, StringConstraints(max_length=40)]], OneOrMore()] = Field(
        default_factory=list
    )
    """Texts that mean that there is no value, such as `NaN`, `-9999` or the empty text; any other
    text that is no number is an error.
    """
    open_end: bool = False
    """Whether the last line may lack its end of line; by default such a file counts as cut off."""


class TimeSource(Source):
    """When the samples of a source were taken: by a column, or by a rate."""

    column: ColumnText | None = None
    """The column of the times; `(time)` for the times that a TDMS or MDF4 file states itself."""
    unit: UnitText | None = None
    """Its unit; by default the one that the file states."""
    rate: QuantityText | None = None
    """Without a column: samples per second, such as `1 kHz`."""
    since: MomentText | None = None
    """The moment that a time of 0 means: `1970-01-01` for Unix times, `1899-12-30` for days of
    Excel, `0000-01-00` for days of MATLAB (datenum); by default `started`. For times of a day: the
    day of the first row.
    """
    format: Annotated[str, StringConstraints(min_length=2, max_length=60)] | None = None
    """The form of times that are written as dates: `iso`, or as Python writes it, such as
    `%d.%m.%Y %H:%M:%S.%f`. They are UTC unless they state their zone, or `zone` does. Without a
    day, as `%H:%M:%S`, they are times of a day: `since` gives the first one, and they go on over
    midnight.
    """
    zone: Annotated[str, StringConstraints(min_length=1, max_length=60)] | None = None
    """The zone of times that are local: a name of the tz database such as `Europe/Berlin`, or a
    fixed offset such as `+01:00`. In the hour that occurs twice a year, times are of its first time
    until they go back.
    """
    wraps: Annotated[str, StringConstraints(min_length=3, max_length=40)] | None = None
    """The range of a counter that begins again at 0: `32 bit` of the unit of the column, or a time
    such as `2^32 us` or `24 h`. The time goes on there. A gap that is longer than the range does
    not show.
    """
    coarse: Literal["spread"] | None = None
    """`spread`: the clock is coarser than the rate of the logger, and several rows have the same
    time. They are spread evenly up to the next one, the first of them at the time that they have.
    """
    shift: QuantityText = "0 s"
    """Added to each time, such as the delay of one logger against the other."""
    restarts: bool = False
    """Whether the times may begin again, as where a file has several tests one after the other.
    What follows is placed 1 s after what was before, or ten usual periods if that is longer; a
    trial must end there.
    """
    longest_gap: QuantityText | None = None
    """The longest time between two samples; by default ten times the usual one. A longer one is an
    error, unless a trial ends there.
    """


class ColumnSource(Source):
    """The column that gives a channel."""

    column: ColumnText
    """Its name in the file, with or without its unit; or its number, from 1."""
    unit: UnitText | None = None
    """Its unit in the file, `1` for none; by default the one that the file states."""
    zero: QuantityText | None = None
    """The reading without any load, in the unit of the column; it is subtracted."""
    scale: QuantityText | None = None
    """What the reading is multiplied by then, such as `250 N/V`. The reading itself is recorded
    beside it, as `NAME_raw`.
    """
    doc: Annotated[str, StringConstraints(max_length=200)] = ""
    """What it is, for people."""


class StreamSource(Source):
    """A table of samples with common times, which becomes one stream."""

    file: PatternText | None = None
    """Which of the files has it, such as `{test}_force.csv`; by default each of them. Files with
    the same `{test}` make one recording.
    """
    format: Format | None = None
    """The format; by default by the ending of the file's name."""
    group: Annotated[str, StringConstraints(min_length=1, max_length=200)] | None = None
    """In a file with several tables: the group (HDF5, TDMS), the structure (MAT; `results(3)` of
    an array of them), or the number or
    name of the channel group (MDF4).
    """
    text: TextTableSource = Field(default_factory=TextTableSource)
    """Of a text file: separator, decimal sign, lines before the data."""
    time: TimeSource
    """When the samples were taken."""
    channels: Annotated[dict[Name, ColumnSource], Field(min_length=1)]
    """The channels by name, each with its column."""
    sparse: bool = False
    """Whether rows without any value of these channels are left out, as where one table has
    columns of different rates.
    """


class SignalSource(Source):
    """A channel that shows when a trial goes on."""

    channel: ChannelName
    """The channel."""
    above: QuantityText | None = None
    """A trial goes on while the channel is above this."""
    below: QuantityText | None = None
    """A trial goes on while the channel is below this."""


class TableFileSource(Source):
    """A table of the trials, a trial in each row."""

    file: PatternText
    """The file beside the others, such as `{test}/trials.csv`."""
    key: ColumnText
    """Its column that holds what the first of `columns` holds."""
    text: TextTableSource = Field(default_factory=TextTableSource)
    """Of a text file: separator, decimal sign, lines before the data."""


class TrialsSource(Source):
    """Where trials begin and end; without it, a file is one trial."""

    source: Name | None = None
    """The source that shows it; by default the first, or that of `signal`."""
    columns: Annotated[list[ColumnText], OneOrMore()] = Field(default_factory=list)
    """A trial ends where the text in one of these columns changes."""
    outside: Annotated[list[Annotated[str, StringConstraints(max_length=60)]], OneOrMore()] = Field(
        default_factory=list
    )
    """Texts in the first of `columns` that mean that no trial goes on."""
    gaps: QuantityText | None = None
    """A trial ends where there is no sample for this long."""
    signal: SignalSource | None = None
    """A trial goes on while a channel is above or below a value."""
    shortest: QuantityText | None = None
    """Shorter ones are no trials."""
    steps: ColumnText | None = None
    """A column with the name of the step that is played, of the same source."""
    table: TableFileSource | None = None
    """A table of the trials, for their parameters; with `columns`."""


class ImportedParameterSource(Source):
    """A parameter of the trials, such as the load or the floor."""

    value: QuantityText | None = None
    """The same for all trials: a quantity such as `4.2 kg`, or a word."""
    column: ColumnText | None = None
    """The column of the table of the trials, or else of the samples, that has it."""
    name: Name | None = None
    """The `{name}` in the names of the files that has it."""
    unit: UnitText | None = None
    """Its unit in column or name, `1` for a plain number; without one it is a word."""


class ImportSource(Source):
    """A map of `rigd import`: what the files of another program mean."""

    map: FileName
    """Name of the map; the recordings have it in place of a procedure."""
    title: Annotated[str, StringConstraints(max_length=120)] = ""
    """What was tested, for people."""
    rig: FileName
    """Name of the rig that the data are from."""
    started: MomentText | None = None
    """When the tests began; by default times with a date show it, or else the date of the file."""
    warnings: Literal["refuse", "accept"] = "refuse"
    """What is done if a library such as npTDMS or asammdf warns while it reads a file: by default
    nothing is imported; with `accept` the recording states the warning.
    """
    sources: Annotated[dict[Name, StreamSource], Field(min_length=1, max_length=32)]
    """The tables of samples by name; each becomes a stream of that name."""
    ignore: Annotated[list[PatternText], OneOrMore()] = Field(default_factory=list)
    """Files that are left out."""
    trials: TrialsSource = Field(default_factory=TrialsSource)
    """Where trials begin and end."""
    parameters: dict[Name, ImportedParameterSource] = Field(default_factory=dict)
    """The parameters of the trials."""
    derived: dict[ChannelName, DerivedSource] = Field(default_factory=dict, max_length=64)
    """Channels that are computed from others, as in a rig file; they are written to the recording.
    """
    identify: IdentifySource | None = None
    """What `rigd identify` shall evaluate, as in a procedure."""


def map_schema() -> dict[str, Any]:
    """Return the JSON Schema of maps."""
    return file_schema(ImportSource, "map of rigd import")
