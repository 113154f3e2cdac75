"""Defines the base class of rows: one sample of a device, with a field for each channel."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from operator import itemgetter
from typing import ClassVar, ParamSpec, TypeVar, dataclass_transform

P = ParamSpec("P")
R = TypeVar("R")


@dataclass_transform(kw_only_default=True, frozen_default=True)
class Row(tuple[float, ...]):
    """One sample.

    A subclass has a field for each channel, then ``status`` if there is one::

        class AxisRow(Row):
            position: float
            speed: float
            status: int

    Values are in the SI units of the channels. A row is made by keyword only, so that no two values
    can change places: ``AxisRow.of(position=0.2, speed=0.0, status=1)``. It is a tuple in the order
    of its fields.
    """

    #: Names of the fields, in order.
    fields: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def of(cls: Callable[P, R], *_: P.args, **values: P.kwargs) -> R:
        """Return a row of these values; each subclass has a function of its own fields.

        A constructor takes three times as long, in every cycle.

        Raises:
            TypeError: a field is missing, is unknown or was not given by keyword.

        """
        raise TypeError(f"{cls} has no fields: derive a class from it")

    def __init_subclass__(cls) -> None:
        """Give the subclass its fields and a function that takes them by keyword."""
        super().__init_subclass__()
        own = tuple(inspect.get_annotations(cls))
        cls.fields = (*cls.fields, *own)
        for position, name in enumerate(cls.fields):
            setattr(cls, name, property(itemgetter(position)))
        names = ", ".join(cls.fields)
        made = eval(f"lambda *, {names}: row(({names},))", {"row": cls})
        cls.of = staticmethod(made)  # type: ignore[method-assign]  # of this class's own fields

    def __repr__(self) -> str:
        """Return the row with the names of its fields."""
        named = zip(self.fields, self, strict=True)
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in named)})"
