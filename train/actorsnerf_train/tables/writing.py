"""A table as Markdown, CSV and LaTeX."""

import csv
import io
from pathlib import Path

from actorsnerf_train.checkpoint import write_whole
from actorsnerf_train.tables.published import published_mean
from actorsnerf_train.tables.table import MEAN, Cell, Number, Row, Table

METRICS = ("PSNR", "SSIM", "LPIPS x1000")
DIGITS = (2, 4, 1)


def write_table(folder: Path, name: str, table: Table, notes: tuple[str, ...]) -> tuple[Path, ...]:
    """The three files, each complete once it bears its name.

    Args:
        folder: where.
        name: of the files, without ending.
        table: what they show.
        notes: sentences under the Markdown table.
    """
    contents = {
        ".md": markdown(table) + "".join(f"\n{note}\n" for note in notes),
        ".csv": comma_separated(table),
        ".tex": latex(table),
    }
    paths = []
    for ending, content in contents.items():
        paths.append(folder / f"{name}{ending}")
        write_whole(paths[-1], content.encode())
    return tuple(paths)


def markdown(table: Table) -> str:
    """Settings by methods down; PSNR / SSIM / LPIPS x 1000 of each actor across."""
    columns = _columns(table)
    head = ["setting", "list", "method", *columns, "steps", "training, s", "category, s"]
    budgets = any(row.budget != "steps" for row in table.rows)
    if budgets:
        head.insert(2, "equal")
    published = any(published_mean(table, row) for row in table.rows)
    if published:
        head.append("mean minus the paper's")
    lines = [
        f"Convention `{table.convention}`, preset `{table.preset}`, data set {table.dataset}: "
        "PSNR / SSIM / LPIPS x1000, mean over seeds (± their standard deviation).",
        "",
        f"| {' | '.join(head)} |",
        f"|{' --- |' * len(head)}",
    ]
    for row in table.rows:
        cells = [_triple(row.cells.get(column)) for column in columns]
        steps = "/".join(f"{step:,}" for step in row.steps)
        words = [row.setting, row.list_name, row.label, *cells, steps, f"{row.seconds:,.0f}"]
        words.append("-" if row.category_seconds is None else f"{row.category_seconds:,.0f}")
        if budgets:
            words.insert(2, row.budget)
        if published:
            words.append(_difference(table, row))
        lines.append(f"| {' | '.join(words)} |")
    return "\n".join(lines) + "\n"


def comma_separated(table: Table) -> str:
    """One line a number: setting, list, method, actor, metric, value, spread, seeds, budget."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    head = "setting list method actor convention metric value spread seeds budget"
    writer.writerow(head.split())
    for row in table.rows:
        for actor, cell in row.cells.items():
            for metric, number in zip(METRICS, _numbers(cell), strict=True):
                if number is None:
                    continue
                spread = "" if number.spread is None else repr(number.spread)
                where = (row.setting, row.list_name, row.label, actor, table.convention)
                writer.writerow(
                    (*where, metric, repr(number.value), spread, cell.seeds, row.budget)
                )
    return text.getvalue()


def latex(table: Table) -> str:
    """In the paper's form: three columns an actor; the best of each setting and budget is bold."""
    columns = _columns(table)
    lines = [
        f"% convention {table.convention}, preset {table.preset}, data set {table.dataset}",
        rf"\begin{{tabular}}{{ll{'rrr' * len(columns)}}}",
        " & ".join(["", "", *(rf"\multicolumn{{3}}{{c}}{{{c}}}" for c in columns)]) + r" \\",
        " & ".join(["Setting", "Method", *[r"PSNR & SSIM & LPIPS$\times$1000"] * len(columns)])
        + r" \\",
        r"\hline",
    ]
    for row in table.rows:
        rivals = [one for one in table.rows if _contest(one) == _contest(row)]
        words = [row.setting if row.budget == "steps" else f"{row.setting}, equal time", row.label]
        for column in columns:
            words += _bold(row, rivals, column)
        lines.append(" & ".join(words) + r" \\")
    return "\n".join([*lines, r"\end{tabular}", ""])


def _columns(table: Table) -> tuple[str, ...]:
    if len(table.actors) < 2 or not any(MEAN in row.cells for row in table.rows):
        return table.actors
    return (*table.actors, MEAN)


def _numbers(cell: Cell) -> tuple[Number | None, ...]:
    return (cell.psnr, cell.ssim, cell.lpips_x1000)


def _triple(cell: Cell | None) -> str:
    if cell is None:
        return "-"
    return " / ".join(
        _text(number, digits) for number, digits in zip(_numbers(cell), DIGITS, strict=True)
    )


def _text(number: Number | None, digits: int) -> str:
    if number is None:
        return "-"
    spread = "" if number.spread is None else f" ± {number.spread:.{digits}f}"
    return f"{number.value:.{digits}f}{spread}"


def _difference(table: Table, row: Row) -> str:
    expected, cell = published_mean(table, row), row.cells.get(MEAN)
    if expected is None or cell is None:
        return "-"
    return " / ".join(
        "-" if number is None else f"{number.value - one:+.{digits}f}"
        for number, one, digits in zip(_numbers(cell), expected, DIGITS, strict=True)
    )


def _bold(row: Row, rivals: list[Row], column: str) -> list[str]:
    words = []
    for metric, digits in enumerate(DIGITS):
        number = _numbers(row.cells[column])[metric] if column in row.cells else None
        if number is None:
            words.append("--")
            continue
        others = [_numbers(r.cells[column])[metric] for r in rivals if column in r.cells]
        values = [other.value for other in others if other is not None]
        best = min(values) if metric == 2 else max(values)
        text = f"{number.value:.{digits}f}"
        text = rf"\textbf{{{text}}}" if number.value == best else text
        spread = "" if number.spread is None else rf" $\pm$ {number.spread:.{digits}f}"
        words.append(text + spread)
    return words


def _contest(row: Row) -> tuple[str, str, str]:
    """Rows that agree in it are compared."""
    return row.setting, row.list_name, row.budget
