"""Reads the numbers of a friction law."""

from __future__ import annotations

from typing import Final

from rigd_sim.mechanism.amounts import Notes, Path
from rigd_sim.mechanism.description import Law
from rigd_sim.mechanism.network import Kind

#: Keys that each law needs, and those that it may have besides.
KEYS: Final = {
    "viscous": (("viscous",), ()),
    "coulomb": (("coulomb",), ("viscous", "smooth")),
    "stribeck": (("coulomb", "static", "stribeck_speed"), ("exponent", "viscous", "smooth")),
    "dahl": (("coulomb", "sigma_0"), ("viscous",)),
    "lugre": (
        ("coulomb", "static", "stribeck_speed", "sigma_0"),
        ("sigma_1", "viscous", "exponent"),
    ),
}
#: Speed below which coulomb and stribeck fade, in m/s or rad/s.
SMOOTH: Final = 1e-3


def law_numbers(
    path: Path, law: Law, force: str, length: str, notes: Notes
) -> tuple[Kind, dict[str, float]]:
    """Return kind and numbers of a law whose forces are in ``force``, displacements in ``length``.

    Raises:
        Wrong: a key is missing, or not of this law.
    """
    needed, more = KEYS[law.kind]
    for key in sorted(law.model_fields_set - {"kind", *needed, *more}):
        raise notes.refuse(
            (*path, key), f"law {law.kind} has no '{key}'; it has {', '.join((*needed, *more))}"
        )
    for key in needed:
        if key not in law.model_fields_set:
            raise notes.refuse(path, f"law {law.kind} needs '{key}'")
    share = force == "1"
    per_length, per_speed = (
        (f"1/{length}", f"s/{length}") if share else (f"{force}/{length}", f"{force} s/{length}")
    )
    most = 10.0 if share else 1e7
    visc = notes.amount((*path, "viscous"), law.viscous, per_speed, high=1e4 if share else 1e8)
    numbers = {"visc": visc}
    bristles = law.kind in ("dahl", "lugre")
    if law.kind != "viscous":
        numbers["f_c"] = notes.amount(
            (*path, "coulomb"), law.coulomb, force, high=most, above=bristles
        )
        numbers["f_s"] = numbers["f_c"]
        numbers["v_s"], numbers["shape"] = 1.0, law.exponent
    if law.static is not None:
        numbers["f_s"] = notes.amount((*path, "static"), law.static, force, high=most)
        if numbers["f_s"] < numbers["f_c"]:
            raise notes.refuse(
                (*path, "static"),
                f"'static', {law.static}, is below 'coulomb', {law.coulomb}: friction at rest is "
                "at least that of sliding",
            )
        numbers["v_s"] = notes.amount(
            (*path, "stribeck_speed"), law.stribeck_speed, f"{length}/s", high=1e4, above=True
        )
    if bristles:
        numbers["s_0"] = notes.amount(
            (*path, "sigma_0"), law.sigma_0, per_length, high=1e10, above=True
        )
        numbers["s_1"] = notes.amount((*path, "sigma_1"), law.sigma_1, per_speed, high=1e8)
        return Kind.BRISTLES, numbers
    numbers["smooth"] = SMOOTH if law.smooth is None else notes.amount(
        (*path, "smooth"), law.smooth, f"{length}/s", high=10.0, above=True
    )  # fmt: skip
    return Kind.SLIDING, numbers
