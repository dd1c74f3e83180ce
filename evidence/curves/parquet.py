"""The table of a sweep as Parquet, beside the CSV file, where pyarrow is installed."""

from pathlib import Path

WITHOUT = "no Parquet beside it: that needs pyarrow, which `make notebooks` installs"


def write_parquet(table: Path) -> Path | None:
    """Write what a CSV file has as Parquet, types included; None if there is no pyarrow."""
    try:
        from pyarrow import csv, parquet
    except ImportError:
        return None
    # Empty cells are null, also in a column of texts; the first row has the names.
    options = csv.ConvertOptions(strings_can_be_null=True)
    file = table.with_suffix(".parquet")
    parquet.write_table(csv.read_csv(table, convert_options=options), file)
    return file
