"""The report as one HTML file: offline, light and dark, printable, readable without JavaScript.

``sections`` writes the tables, ``charts`` the plots, ``projection`` the 2-D view of the manifold,
``still`` the first frame without JavaScript, ``payload`` the numbers for the scripts, whose files
lie beside this one. All text from documents and file names is escaped, and a content security
policy allows only the style and the script of this page.
"""

from __future__ import annotations

import base64
import hashlib
from importlib import resources
from string import Template

from mssegment.inputs.text import printable
from mssegment.rendering.markup import escape
from mssegment.rendering.page import payload, sections, still
from mssegment.rendering.report import Report
from mssegment.rendering.style import hexadecimal
from mssegment.rendering.tables import summary
from mssegment.version import __version__

__all__ = ["render_page"]

SCRIPTS = ("data.js", "picture.js", "track.js", "table.js", "start.js")


def render_page(report: Report) -> str:
    """The report as the text of one self-contained HTML file."""
    style = asset("page.css") + label_rules(report)
    script = page_script() if report.frames else ""
    page = Template(asset("template.html")).substitute(
        policy=content_policy(style, script),
        style=style,
        script=script,
        title=escape(page_title(report)),
        headline=escape(summary(report)),
        notes="".join(f"<li>{escape(note)}</li>" for note in report.notes),
        frames=still.frames_html(report, payload.photographs(report)),
        toggles=sections.toggles_html(report),
        many=" many" if len(payload.shown_labels(report)) > sections.MAX_TOGGLES else "",
        motions=sections.motions_html(report),
        modes=sections.modes_html(report),
        manifolds=sections.manifolds_html(report),
        residuals=sections.residuals_html(report),
        confusion=sections.confusion_html(report),
        tracks=sections.tracks_html(report),
        provenance=sections.provenance_html(report),
        version=escape(__version__),
        noun=report.noun,
        unit="pixels" if report.of_pictures else "the unit of the data",
        data=payload.as_script(payload.numbers(report)),
    )
    # bytes of a file name that are no text become question marks
    return page.encode("utf-8", "replace").decode("utf-8")


def page_title(report: Report) -> str:
    """The title: the summary, and the names of the first and the last frame."""
    names = [printable(frame.path.rpartition("/")[2]) for frame in report.frames]
    shown = ", ".join(dict.fromkeys([names[0], names[-1]])) if names else "no frames"
    return f"{summary(report)} · {shown}"


def asset(name: str) -> str:
    """The text of a file beside this one."""
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def page_script() -> str:
    """The scripts as one, in the order of their dependencies."""
    parts = "\n".join(asset(name) for name in SCRIPTS)
    return f'"use strict";\n(() => {{\n{parts}\n}})();\n'


def content_policy(style: str, script: str) -> str:
    """A content security policy that allows this style and script only, and no requests."""

    def digest(text: str) -> str:
        return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()

    return (
        f"default-src 'none'; img-src data:; style-src 'sha256-{digest(style)}'; "
        f"script-src 'sha256-{digest(script)}'; base-uri 'none'; form-action 'none'"
    )


def label_rules(report: Report) -> str:
    """Style rules of every label: its colour, and the class of the page that hides it in plots."""
    rules = []
    for label in payload.shown_labels(report):
        name = payload.label_class(label)
        rules.append(f".{name}{{--c:{hexadecimal(report.style(label).colour)}}}")
        rules.append(f".hide-{name} svg .{name}{{visibility:hidden}}")
    return "\n".join(["", *rules, ""])
