"""Procedure files: read, checked, compiled to cycle programs."""

from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import Procedure, load_procedure, parse_procedure
from rigd.procedure.program import CompiledProcedure
from rigd.procedure.schema import procedure_schema

__all__ = [
    "CompiledProcedure",
    "Procedure",
    "compile_procedure",
    "load_procedure",
    "parse_procedure",
    "procedure_schema",
]
