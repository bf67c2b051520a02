"""One tidy table of a cohort, a row a patient, view and target; warnings; failures; summary."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from io import TextIOWrapper
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.random import default_rng

from mammosim.cohort.description import Cohort, dotted
from mammosim.cohort.distributions import LEFT_OUT, Choice, Column, Distribution
from mammosim.cohort.patient import Outcome
from mammosim.cohort.status import warnings_of
from mammosim.config import open_file
from mammosim.export import csv_text, text_of_csv, whole_file, write_text
from mammosim.pipeline import read_record
from mammosim.report import contact_sheet, render_cohort
from mammosim.targets import Target

PARQUET, CSV, SUMMARY = "table.parquet", "table.csv", "summary.html"
WARNINGS, FAILURES = "warnings.csv", "failures.csv"

ROWS_OF = 500
"""Patients whose rows are in memory together."""

OF_VIEW = {
    "model": pa.string(), "thickness_mm": pa.float64(), "force_n": pa.float64(),
    "target": pa.string(), "filter": pa.string(), "kvp": pa.float64(), "mas": pa.float64(),
    "hvl_mm_al": pa.float64(), "air_kerma_mgy": pa.float64(), "dose_mgy": pa.float64(),
    "volumetric_density_percent": pa.float64(), "glandularity_percent": pa.float64(),
    "scatter_to_primary_ratio": pa.float64(),
}  # fmt: skip
"""Numbers of a view in a run's record, and their types."""

ANODE = {"target": "anode"}
"""Columns that are called otherwise in the table, where `target` would be a lesion."""

OF_TARGET = {"int": pa.int64(), "float": pa.float64(), "bool": pa.bool_(), "str": pa.string()}

SECONDS = ("phantom", "compression", "projection", "acquisition")
"""Stages whose wall time has a column; the last columns, and the only ones a rerun changes."""


def write_tables(
    cohort: Cohort,
    folder: Path,
    finished: Sequence[tuple[int, Path]],
    failed: Sequence[Outcome],
) -> None:
    """Write `table.parquet`, `table.csv`, `warnings.csv`, `failures.csv` and `summary.html`.

    Parameters
    ----------
    cohort : Cohort
    folder : Path
        The cohort's.
    finished : sequence of (int, Path)
        Number and folder of each patient that is there.
    failed : sequence of Outcome
    """
    schema = table_schema(cohort)
    warned: dict[int, tuple[str, ...]] = {}
    with (
        whole_file(folder / PARQUET) as parquet,
        whole_file(folder / CSV) as text,
        pa.parquet.ParquetWriter(parquet, schema) as columns,
        pa.csv.CSVWriter(text, schema) as lines,
    ):
        for start in range(0, len(finished), ROWS_OF):
            rows: list[dict[str, Any]] = []
            for index, path in finished[start : start + ROWS_OF]:
                record = read_record(path)
                warned[index] = warnings_of(record)
                rows += _rows(cohort, index, path, record)
            table = pa.Table.from_pylist(rows, schema)
            columns.write_table(table)
            lines.write_table(pa.Table.from_pylist([_as_cells(row) for row in rows], schema))
    _write_csv(
        folder / WARNINGS, ("patient", "warning"),
        ((index, csv_text(text)) for index, found in warned.items() for text in found),
    )  # fmt: skip
    _write_csv(
        folder / FAILURES, ("patient", "kind", "reason"),
        ((outcome.index, outcome.kind, csv_text(outcome.reason)) for outcome in failed),
    )  # fmt: skip
    reasons = [(outcome.index, outcome.reason) for outcome in failed]
    drawn = {
        dotted(path): [_cell(value) for value in law.choice] if isinstance(law, Choice) else []
        for path, law in cohort.distributions.items()
    }
    table = pa.parquet.read_table(folder / PARQUET).to_pydict()
    sheet = contact_sheet(folder, finished)
    links = {
        index: (path / "report.html").relative_to(folder).as_posix()
        for index, path in finished
        if (path / "report.html").is_file()
    }
    page = render_cohort(cohort.title, table, drawn, reasons, sheet, warned, links)
    write_text(folder / SUMMARY, page)


def _write_csv(path: Path, heading: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(heading)
    writer.writerows(rows)
    write_text(path, stream.getvalue())


def table_schema(cohort: Cohort) -> pa.Schema:
    """Columns of the table and their types."""
    drawn = [(dotted(path), _type_of(law, cohort)) for path, law in cohort.distributions.items()]
    targets = [(part.name, OF_TARGET[str(part.type)]) for part in fields(Target)]
    views = [(ANODE.get(name, name), kind) for name, kind in OF_VIEW.items()]
    seconds = [(f"{stage}_seconds", pa.float64()) for stage in (*SECONDS, "all")]
    ours = [("patient", pa.int64()), ("seed", pa.int64())]
    warnings = [("warnings", pa.int64())]
    # A key that is a column anyway, as laterality, has one: the run says what came of it.
    return pa.schema(list(dict([*ours, *drawn, *targets, *views, *warnings, *seconds]).items()))


def _type_of(law: Distribution, cohort: Cohort) -> pa.DataType:
    values: Sequence[Any]
    if isinstance(law, Choice):
        values = law.choice
    elif isinstance(law, Column):
        values = [law.draw(default_rng(0), row) for row in cohort.rows]
    else:
        return pa.int64() if law.decimals == 0 else pa.float64()
    kinds = {type(value) for value in values if value is not LEFT_OUT}
    if kinds == {bool}:
        return pa.bool_()
    if kinds == {int}:
        return pa.int64()
    return pa.float64() if kinds and kinds <= {int, float} else pa.string()


def _rows(
    cohort: Cohort, index: int, folder: Path, record: Mapping[str, Any]
) -> Iterator[dict[str, Any]]:
    """A patient's rows, from its folder and its run's record."""
    drawn = {name: _cell(value) for name, value in cohort.drawn(index).items()}
    seconds = record.get("stage_seconds", {})
    warnings = len(warnings_of(record))
    views = {
        (view["laterality"], view["view"]): (name, view)
        for name, view in record.get("views", {}).items()
    }
    with TextIOWrapper(open_file(folder / "lesions.csv"), "utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            name, view = views[row["laterality"], row["view"]]
            yield {
                "patient": index,
                **drawn,
                **{part.name: _parsed(row[part.name], str(part.type)) for part in fields(Target)},
                **{ANODE.get(key, key): view.get(key) for key in OF_VIEW},
                "warnings": warnings,
                **{f"{stage}_seconds": seconds.get(stage, seconds.get(f"{name}.{stage}"))
                   for stage in SECONDS},
                "all_seconds": sum(seconds.values()),
            }  # fmt: skip


def _cell(value: Any) -> Any:
    if value is LEFT_OUT:
        return None
    return json.dumps(value) if isinstance(value, (dict, list, tuple)) else value


def _as_cells(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row whose text no spreadsheet computes."""
    return {
        name: csv_text(value) if isinstance(value, str) else value for name, value in row.items()
    }


def _parsed(text: str, kind: str) -> Any:
    if kind == "bool":
        return text == "true"
    if kind == "str":
        return text_of_csv(text)
    if not text:
        return None
    return int(text) if kind == "int" else float(text)
