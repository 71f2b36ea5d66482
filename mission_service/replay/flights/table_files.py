"""Writes tables as CSV and Parquet, with at most one row group in memory."""

import csv
from datetime import datetime
from pathlib import Path
from typing import Any, Protocol, Self

from mission_service.replay.flights.flight_tables import TABLES, Columns, Row
from mission_service.replay.flights.utc_time import utc

GROUP_ROWS = 10_000


class TableFile(Protocol):
    """One table in one file."""

    def add_row(self, row: Row) -> None:
        """Add the next row."""

    def close(self) -> None:
        """Write the remaining rows and close the file."""


class CsvFile:
    """A table as CSV, in which unknown values are empty and UTC times have milliseconds."""

    def __init__(self, path: Path, columns: Columns) -> None:
        self._file = path.open("w", newline="", encoding="utf-8")
        self._table = csv.writer(self._file)
        self._table.writerow(columns)
        self._dated = [place for place, kind in enumerate(columns.values()) if kind is datetime]

    def add_row(self, row: Row) -> None:
        """Add the next row."""
        written = list(row)
        for place in self._dated:
            written[place] = None if row[place] is None else utc(row[place])
        self._table.writerow(written)

    def close(self) -> None:
        """Write the remaining rows and close the file."""
        self._file.close()


class ParquetFile:
    """A table as Parquet, in which unknown values are null and UTC times are in microseconds."""

    def __init__(self, path: Path, columns: Columns) -> None:
        import pyarrow
        from pyarrow.parquet import ParquetWriter

        kinds = {
            str: pyarrow.string(),
            int: pyarrow.int64(),
            float: pyarrow.float64(),
            bool: pyarrow.bool_(),
            datetime: pyarrow.timestamp("us", tz="UTC"),
        }
        self._schema: Any = pyarrow.schema([(name, kinds[kind]) for name, kind in columns.items()])
        self._batch_of: Any = pyarrow.RecordBatch.from_arrays
        self._array: Any = pyarrow.array
        self._writer: Any = ParquetWriter(path, self._schema)
        self._rows: list[Row] = []

    def add_row(self, row: Row) -> None:
        """Add the next row."""
        self._rows.append(row)
        if len(self._rows) == GROUP_ROWS:
            self._write()

    def close(self) -> None:
        """Write the remaining rows and close the file."""
        if self._rows:
            self._write()
        self._writer.close()

    def _write(self) -> None:
        columns = zip(*self._rows, strict=True)
        arrays = [
            self._array(values, type=field.type)
            for values, field in zip(columns, self._schema, strict=True)
        ]
        self._rows = []
        self._writer.write_batch(self._batch_of(arrays, schema=self._schema))


WRITERS: dict[str, type[CsvFile] | type[ParquetFile]] = {"csv": CsvFile, "parquet": ParquetFile}


class TableFiles:
    """The files of all tables that have rows, one file for each format."""

    def __init__(self, out: Path, formats: list[str]) -> None:
        self._out = out
        self._formats = formats
        self._files: dict[str, list[TableFile]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        for files in self._files.values():
            for file in files:
                file.close()

    def add_row(self, table: str, row: Row) -> None:
        """Add the next row of a table."""
        if table not in self._files:
            self._files[table] = [
                WRITERS[each](self._out / f"{table}.{each}", TABLES[table])
                for each in self._formats
            ]
        for file in self._files[table]:
            file.add_row(row)

    @property
    def names(self) -> list[str]:
        """The names of the files, in the order of the tables."""
        return [f"{table}.{each}" for table in sorted(self._files) for each in self._formats]
