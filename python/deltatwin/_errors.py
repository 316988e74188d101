"""Errors of the package."""

from __future__ import annotations


class ModelError(ValueError):
    """A model, scenario, path or study that is not valid.

    ``path``, ``line`` and ``column`` (from 1) say where, if the error is at a place of a file; else they are ``None``.
    """

    def __init__(
        self,
        message: str,
        path: str | None = None,
        line: int | None = None,
        column: int | None = None,
    ) -> None:
        super().__init__(message)
        self.path = path
        self.line = line
        self.column = column

    def __reduce__(self) -> tuple[type[ModelError], tuple[str, str | None, int | None, int | None]]:
        return type(self), (str(self), self.path, self.line, self.column)


class DataError(ValueError):
    """A recording that is not valid, or that cannot be of the model's machine.

    ``row`` (as the file counts it, ``"line 17"``, or the index of an array) and ``column`` say where, if the error is
    in one value; else they are ``None``.
    """

    def __init__(
        self,
        message: str,
        path: str | None = None,
        row: str | None = None,
        column: str | None = None,
    ) -> None:
        super().__init__(message)
        self.path = path
        self.row = row
        self.column = column

    def __reduce__(self) -> tuple[type[DataError], tuple[str, str | None, str | None, str | None]]:
        return type(self), (str(self), self.path, self.row, self.column)
