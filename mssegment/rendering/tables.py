"""Tables as text, Markdown, LaTeX or CSV: the results, and the two of the paper (figures 2-4).

A table is a header and rows of strings; ``format_table`` lays it out, and ``format_report`` puts
the tables of a report together. Nothing here prints or colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from unicodedata import east_asian_width

from mssegment.inputs.text import printable
from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER, Record, replace
from mssegment.rendering.report import Report
from mssegment.rendering.report_json import report_bytes
from mssegment.rendering.style import GLYPHS

FORMATS = ("text", "json", "csv", "markdown", "latex")


class Table(Record, frozen=True):
    """A header and rows of cells; a line is drawn above each of the rows ``rules``."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    rules: tuple[int, ...] = ()


def result_table(report: Report, *, plain: bool = False) -> Table:
    """One row per motion: inliers, hypotheses, kernel density, RMS residual; then other labels.

    ``plain`` gives numbers without markers, for other programs, and the camera a column.
    """
    header = [report.noun, "inliers", "hypotheses", "kde", f"rms {report.unit}".strip()]
    with_truth = report.evaluation is not None
    with_model = len({chosen.model for chosen in report.sets}) > 1
    with_camera = plain and report.camera_motion is not None
    header += (
        ["model"] * with_model + [f"true {report.noun}"] * with_truth + ["camera"] * with_camera
    )
    rows = []
    for motion in report.motions:
        modes = report.modes_of(motion.label)
        is_camera = motion.label == report.camera_motion
        name = f"{motion.label} {report.style(motion.label).glyph}{' camera' if is_camera else ''}"
        row = [
            str(motion.label) if plain else name,
            str(len(report.members(motion.label))),
            str(sum(mode.hypotheses for mode in modes)),
            density(modes[0].kde if modes else None),
            fixed(motion.rms, 2) if report.of_pictures else number(motion.rms, 3),
        ]
        if with_model:
            row.append(motion.model)
        if with_truth:
            true = report.true_motion(motion.label)
            row.append("-" if true is None else str(true))
        if with_camera:
            row.append("yes" if is_camera else "no")
        rows.append(tuple(row))
    blank = ("",) * (len(header) - 2)
    counted = [("outliers", OUTLIER), ("background", BACKGROUND), ("not judged", NOT_JUDGED)]
    tail = [(name, str(len(report.members(label))), *blank) for name, label in counted]
    kept = [row for row in tail if row[0] == "outliers" or row[1] != "0"]
    return Table(f"{report.noun}s".title(), tuple(header), (*rows, *kept), rules=(len(rows),))


def modes_table(report: Report, limit: int | None = None) -> Table:
    """The paper's left table: hypotheses and kernel density of each mode, strongest first.

    Parameters
    ----------
    report : Report
        The segmentation.
    limit : int, optional
        Modes that are shown, besides all that became motions. By default at least four and one
        more than there are motions, as in the paper.
    """
    modes = report.segmentation.modes
    limit = max(4, len(report.motions) + 1) if limit is None else limit
    several = len(report.sets) > 1
    header = ["mode", "hypotheses", "kde", report.noun] + (["set"] if several else [])
    rows = []
    for i, mode in enumerate(modes):
        if i >= limit and mode.motion <= 0:
            continue
        row = [f"M{i + 1}", str(mode.hypotheses), density(mode.kde)]
        row.append(str(mode.motion) if mode.motion else "-")
        rows.append(tuple(row + ([str(mode.set_index + 1)] if several else [])))
    return Table("Modes", tuple(header), tuple(rows))


def confusion_table(report: Report) -> Table | None:
    """The paper's right table: the confusion matrix, with the residual errors (23) and (24).

    None without true labels.
    """
    evaluation = report.evaluation
    if evaluation is None or report.res is None or report.res_hat is None:
        return None
    order = {motion.label: i for i, motion in enumerate(report.motions)}
    back = {true: found for found, true in evaluation.matching.items()}
    header = ["", *(f"found {f}" for f in evaluation.found_motions), "outlier", "res", "res-hat"]
    zero = "outlier" if evaluation.world is None else "background 0"
    rows = []
    for i, true in enumerate(evaluation.true_motions):
        cells = [str(count) for count in evaluation.confusion[i]]
        found = order.get(back.get(true, 0))
        errors = [] if found is None else [report.res[found], report.res_hat[found]]
        rows.append((f"true {true}", *cells, *([number(e, 4) for e in errors] or ["", ""])))
    last = [str(count) for count in evaluation.confusion[-1]]
    rows.append((zero, *last, "", ""))
    return Table("Confusion matrix", tuple(header), tuple(rows), rules=(len(rows) - 1,))


def objects_table(report: Report) -> Table | None:
    """How well each true object is found: IoU of its tracks, J and F of its masks.

    None without true labels.
    """
    evaluation = report.evaluation
    if evaluation is None:
        return None
    masks = {quality.true: quality for quality in report.mask_quality}
    back = {true: found for found, true in evaluation.matching.items()}
    header = ["", "motion", "IoU of tracks"] + (["J", "F"] if masks else [])
    rows = []
    for true in sorted({*evaluation.true_motions, *masks}):
        row = [f"true {true}", str(back.get(true, "-")), fixed(evaluation.iou.get(true), 3)]
        if masks:
            own = masks.get(true)
            row += [fixed(own.region, 3), fixed(own.contour, 3)] if own else ["-", "-"]
        rows.append(tuple(row))
    return Table("Objects", tuple(header), tuple(rows)) if rows else None


def tables_of(report: Report, *, plain: bool = False) -> list[Table]:
    """The tables of a report; modes and confusion matrix only where there are any."""
    modes, confusion, objects = modes_table(report), confusion_table(report), objects_table(report)
    return [
        result_table(report, plain=plain),
        *([modes] if modes.rows else []),
        *([] if confusion is None else [confusion]),
        *([] if objects is None else [objects]),
    ]


def summary(report: Report) -> str:
    """One line: the number of motions, and the misclassification if there are true labels."""
    count = len(report.motions)
    noun = report.noun
    motions = f"no {noun}" if count == 0 else f"{count} {noun}{'s' if count > 1 else ''}"
    text = f"{motions} in {len(report.labels)} {report.things}"
    if report.evaluation is None:
        return text
    evaluation = report.evaluation
    share = 100 * evaluation.misclassification
    return (
        f"{text}; {share:.2f} % of {evaluation.counted} evaluated tracks misclassified, adjusted "
        f"Rand index {evaluation.adjusted_rand:.3f}"
    )


def format_report(report: Report, form: str = "text") -> str:
    """The report in one of ``FORMATS``, ending with a newline; raises ValueError for another."""
    if form == "json":
        return report_bytes(report).decode()
    if form not in FORMATS:
        raise ValueError(f"format {form!r}: expected {', '.join(FORMATS)}")
    parts = [format_table(table, form) for table in tables_of(report, plain=form == "csv")]
    if form == "csv":
        return "\n".join(parts)
    closing = {"text": "{}", "markdown": "{}", "latex": "% {}"}[form]
    lines = [closing.format(line) for line in [summary(report), *report.notes]]
    if form == "latex":
        return "\n".join(parts) + "\n".join(lines) + "\n"
    return "\n".join(parts) + "\n" + "\n".join(_escape_notes(lines, form)) + "\n"


def format_table(table: Table, form: str) -> str:
    """One table as text, Markdown, LaTeX or CSV, ending with a newline.

    Examples
    --------
    >>> table = Table("Modes", ("mode", "hypotheses"), (("M1", "171"), ("M2", "63")))
    >>> print(format_table(table, "text"), end="")
    mode   hypotheses
    M1            171
    M2             63
    """
    writers = {"text": _text, "markdown": _markdown, "latex": _latex, "csv": _csv}
    # CSV is data, and neutralised on its own
    shown = str if form == "csv" else printable
    rows = tuple(tuple(map(shown, row)) for row in table.rows)
    return writers[form](replace(table, rows=rows))


def number(value: float | None, digits: int = 3) -> str:
    """A number with ``digits`` significant digits, ``-`` for None and NaN.

    With an exponent below 1e-4 and from 1e6 on.

    Examples
    --------
    >>> number(0.0274894), number(5.1e-7), number(None)
    ('0.0275', '5.10e-07', '-')
    """
    if value is None or value != value:
        return "-"
    if value == 0:
        return "0"
    if abs(value) < 1e-4 or abs(value) >= 1e6:
        return f"{value:.{digits - 1}e}"
    text = f"{value:#.{digits}g}"
    if "e" in text:
        text = f"{value:.0f}"
    return text.removesuffix(".")


def fixed(value: float | None, places: int) -> str:
    """A number with ``places`` decimal places, ``-`` for None and NaN."""
    return "-" if value is None or value != value else f"{value:.{places}f}"


def density(value: float | None) -> str:
    """A kernel density as in the paper's tables: four decimal places, more for smaller values."""
    if value is not None and 0 < value < 5e-5:
        return number(value, 2)
    return fixed(value, 4)


def _width(text: str) -> int:
    """Width in terminal columns."""
    return sum(2 if east_asian_width(c) in "WF" else 1 for c in text)


def _pad(text: str, width: int, left: bool) -> str:
    space = " " * (width - _width(text))
    return text + space if left else space + text


def _text(table: Table) -> str:
    rows = [table.header, *table.rows]
    widths = [max(_width(row[i]) for row in rows) for i in range(len(table.header))]
    lines = [
        "   ".join(_pad(cell, widths[i], i == 0) for i, cell in enumerate(row)).rstrip()
        for row in rows
    ]
    return "\n".join(lines) + "\n"


def _markdown(table: Table) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(_markdown_escape(cell) for cell in cells) + " |"

    ruler = "| " + " | ".join([":--", *["--:"] * (len(table.header) - 1)]) + " |"
    return "\n".join([line(table.header), ruler, *map(line, table.rows)]) + "\n"


def _markdown_escape(cell: str) -> str:
    for sign in "\\|^*_<`[":
        cell = cell.replace(sign, "\\" + sign)
    return cell


_LATEX = {
    "\\": r"\textbackslash{}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    **{sign: "\\" + sign for sign in "&%$#_{}"},
}


def _latex_escape(cell: str) -> str:
    if cell == "res-hat":
        return r"$\widehat{\mathrm{res}}$"
    # LaTeX needs packages for the markers
    cell = " ".join(word for word in cell.split(" ") if word not in GLYPHS.values())
    return "".join(_LATEX.get(sign, sign) for sign in cell)


def _latex(table: Table) -> str:
    def line(cells: Sequence[str]) -> str:
        return "  " + " & ".join(_latex_escape(cell) for cell in cells) + r" \\"

    body = [
        text
        for i, row in enumerate(table.rows)
        for text in ([r"  \hline"] if i in table.rules else []) + [line(row)]
    ]
    columns = "l" + "r" * (len(table.header) - 1)
    return "\n".join(
        [
            rf"\begin{{tabular}}{{{columns}}}  % {table.title}",
            r"  \hline",
            line(table.header),
            r"  \hline",
            *body,
            r"  \hline",
            r"\end{tabular}",
            "",
        ]
    )


def _csv(table: Table) -> str:
    from mssegment.rendering.csv_text import csv_bytes

    return csv_bytes(table.header, table.rows).decode()


def _escape_notes(lines: Sequence[str], form: str) -> list[str]:
    return [_markdown_escape(line) for line in lines] if form == "markdown" else list(lines)
