"""The page in a real browser: Chromium through Playwright; skips, saying why, where either lacks.

``pip install '.[browser]'`` and Debian's package ``chromium`` (or any Chromium or Chrome that
``$MSSEGMENT_CHROMIUM`` names) make these tests run.
"""

from __future__ import annotations

import os
import shutil
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from rendering_samples import affine_report, crowd, many_tracks

from mssegment.ground_truth import true_labels
from mssegment.labelling import LabelServer
from mssegment.records import Frame, replace
from mssegment.rendering.page import render_page

playwright = pytest.importorskip("playwright.sync_api", reason="pip install '.[browser]'")

NASTY = "<img src=x onerror=alert(1)>.png"


def find_chromium() -> str | None:
    named = os.environ.get("MSSEGMENT_CHROMIUM")
    names = ("chromium", "chromium-browser", "google-chrome")
    return named or next(filter(None, map(shutil.which, names)), None)


@pytest.fixture(scope="module")
def browser():
    path = find_chromium()
    if path is None:
        pytest.skip("no Chromium: install Debian's chromium, or set MSSEGMENT_CHROMIUM")
    quiet = ["--disable-gpu", "--disable-background-networking", "--disable-component-update"]
    root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=path, args=[*quiet, *root])
        yield browser
        browser.close()


class Opened:
    """A page, what its console said, and what it asked the network for."""

    def __init__(self, page, path: Path) -> None:
        self.page = page
        self.complaints: list[str] = []
        self.requests: list[str] = []
        page.on("console", lambda m: self._hear(m.type, m.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("dialog", lambda dialog: self.complaints.append(f"dialog {dialog.message}"))
        page.on("request", lambda request: self._ask(request.url))
        page.goto(path.as_uri())
        page.wait_for_selector("body.live")

    def _hear(self, kind: str, text: str) -> None:
        # reading the canvas back is our own doing, in ``ink``
        if kind in ("error", "warning") and "willReadFrequently" not in text:
            self.complaints.append(text)

    def _ask(self, url: str) -> None:
        if not url.startswith(("file:", "data:")):
            self.requests.append(url)

    def ink(self, label: int) -> int:
        """How many pixels the layer of a label has drawn; 0 while it is hidden."""
        return self.page.evaluate(
            """([red, green, blue]) => {
                let sum = 0;
                for (const canvas of document.querySelectorAll('#stage canvas:not([hidden])')) {
                  const { width, height } = canvas;
                  const d = canvas.getContext('2d').getImageData(0, 0, width, height).data;
                  for (let i = 0; i < d.length; i += 4) {
                    const same = d[i] === red && d[i + 1] === green && d[i + 2] === blue;
                    if (same && d[i + 3] > 250) sum++;
                  }
                }
                return sum; }""",
            list(COLOURS[label]),
        )

    def clean(self) -> None:
        assert self.complaints == []
        assert self.requests == []


COLOURS = {1: (230, 159, 0), 2: (86, 180, 233)}


@pytest.fixture
def open_page(browser, tmp_path):
    contexts = []

    def open_it(report, **context) -> Opened:
        path = tmp_path / "report.html"
        path.write_text(render_page(report), encoding="utf-8")
        contexts.append(
            browser.new_context(**{"viewport": {"width": 1300, "height": 900}} | context)
        )
        return Opened(contexts[-1].new_page(), path)

    yield open_it
    for context in contexts:
        context.close()


@pytest.fixture
def pair(open_page) -> Opened:
    return open_page(affine_report())


def test_switches_hide_and_show_a_motion(pair):
    before = pair.ink(1)
    assert before > 200
    pair.page.uncheck("#labels input[data-label='1']")
    assert pair.ink(1) == 0
    assert pair.ink(2) > 200
    hidden = pair.page.eval_on_selector(
        "svg .hypothesis.motion1", "dot => getComputedStyle(dot).visibility"
    )
    assert hidden == "hidden"
    pair.page.check("#labels input[data-label='1']")
    assert pair.ink(1) == before
    pair.clean()


def test_all_and_none_switch_everything(open_page):
    opened = open_page(many_tracks(tracks=200, frames=2))
    assert opened.ink(1) > 100
    opened.page.click("#show-none")
    assert opened.ink(1) == opened.ink(2) == 0
    opened.page.click("#show-all")
    assert opened.ink(1) > 100
    opened.clean()


def test_slider_buttons_and_blink_change_the_frame(open_page):
    opened = open_page(affine_report(frames=4))
    page = opened.page
    shown = "document.querySelector('.frame.current').alt"
    assert "Frame 1 of 4" in page.evaluate(shown)
    page.fill("#slider", "3")
    assert "Frame 3 of 4" in page.evaluate(shown)
    page.click("#forward")
    assert "Frame 4 of 4" in page.evaluate(shown)
    page.click("#forward")
    assert "Frame 1 of 4" in page.evaluate(shown)
    page.click("#blink")
    page.wait_for_selector(".frame.current[alt*='Frame 2 of 4']")
    page.click("#blink")
    opened.clean()


def test_hover_describes_the_track_and_a_click_finds_it_in_the_table(pair):
    report = affine_report()
    track = int(report.members(2)[3])
    x, y = report.tracks.points[track, 0]
    box = pair.page.locator("#stage").bounding_box()
    ratio = box["width"] / report.frames[0].width
    place = (box["x"] + (x + 0.5) * ratio, box["y"] + (y + 0.5) * ratio)
    pair.page.mouse.move(*place)
    details = pair.page.inner_text("#details")
    assert f"Track {track + 1}" in details
    assert "motion 2" in details
    assert f"x {x:.1f}" in details
    pair.page.mouse.click(*place)
    row = pair.page.locator("#track-table tr.selected")
    assert row.locator("th").inner_text() == str(track + 1)
    pair.clean()


def test_keyboard_alone_does_it_all(pair):
    page = pair.page
    page.focus("#stage")
    page.keyboard.press("ArrowRight")
    assert "Track 1" in page.inner_text("#details")
    page.keyboard.press("ArrowRight")
    assert "Track 2" in page.inner_text("#details")
    page.keyboard.press("1")
    assert pair.ink(1) == 0
    page.keyboard.press(".")
    assert "Frame 2 of 2" in page.evaluate("document.querySelector('.frame.current').alt")
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.closest('tr').classList.contains('selected')")
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "stage"
    pair.clean()


def test_escape_clears_the_selection(pair):
    page = pair.page
    page.focus("#stage")
    page.keyboard.press("ArrowRight")
    assert page.locator("#details").is_visible()
    page.keyboard.press("Escape")
    assert page.locator("#details").is_hidden()
    pair.clean()


def test_errors_are_highlighted_and_listed(open_page):
    opened = open_page(affine_report(errors=3))
    page = opened.page
    assert page.inner_text("#error-count") == "3"
    blank = page.evaluate(ERROR_RINGS)
    page.check("#show-errors")
    assert blank == 0
    assert page.evaluate(ERROR_RINGS) > 50
    page.select_option("#filter", "errors")
    assert "3 tracks" in page.inner_text("#page-name")
    assert page.locator("#track-table td:has-text('(error)')").count() == 3
    opened.clean()


ERROR_RINGS = """() => {
    let sum = 0;
    for (const canvas of document.querySelectorAll('#stage canvas:not([hidden])')) {
      const { width, height } = canvas;
      const d = canvas.getContext('2d').getImageData(0, 0, width, height).data;
      for (let i = 0; i < d.length; i += 4) {
        if (d[i] === 213 && d[i + 1] === 0 && d[i + 2] === 0 && d[i + 3] > 250) sum++;
      }
    }
    return sum; }"""
"""Pixels in the colour of the rings around errors."""


def test_the_table_sorts_filters_and_turns_pages(pair):
    page = pair.page
    first = "#track-table tbody tr:first-child th"
    page.click("#page-forward")
    assert page.inner_text(first) == "26"
    page.select_option("#filter", "2")
    assert "20 tracks" in page.inner_text("#page-name")
    page.click("#track-table thead th:last-child button")
    values = page.locator("#track-table tbody td:last-child").all_inner_texts()
    assert [float(v) for v in values] == sorted(float(v) for v in values)
    pair.clean()


def test_names_of_files_and_notes_stay_text(open_page):
    report = affine_report(
        frames=2,
        history=[{"stage": NASTY, "settings": {NASTY: "</script><script>alert(2)</script>"}}],
    )
    frames = tuple(Frame(NASTY, f.width, f.height) for f in report.frames)
    opened = open_page(replace(report, frames=frames))
    opened.page.click("#forward")
    assert NASTY in opened.page.inner_text("#frame-name")
    assert NASTY in opened.page.inner_text("#provenance")
    assert opened.page.locator("img[src=x]").count() == 0
    opened.clean()


def serious_violations(page) -> list[tuple[str, str]]:
    axe = pytest.importorskip(
        "axe_playwright_python.sync_playwright", reason="pip install '.[browser]'"
    )
    found = axe.Axe().run(page).response["violations"]
    return [
        (violation["id"], violation["nodes"][0]["html"])
        for violation in found
        if violation["impact"] in ("serious", "critical")
    ]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_violation(open_page, scheme):
    report = affine_report(history=[{"stage": "match", "version": "1", "settings": {"a": 1}}])
    # the policy of the page would keep axe itself out
    opened = open_page(report, color_scheme=scheme, bypass_csp=True)
    opened.page.focus("#stage")
    opened.page.keyboard.press("ArrowRight")
    assert serious_violations(opened.page) == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_violation_on_the_labelling_page(browser, label_server, scheme):
    context = browser.new_context(color_scheme=scheme, bypass_csp=True)
    page = context.new_page()
    page.goto(label_server.url)
    page.wait_for_selector("#stage:focus")
    for key in ["Space", "ArrowRight", "Space", "ArrowDown", "Space", "Enter"]:
        page.keyboard.press(key)
    assert serious_violations(page) == []
    context.close()


def test_without_javascript_everything_but_the_switches_is_there(browser, tmp_path):
    path = tmp_path / "report.html"
    path.write_text(render_page(affine_report()), encoding="utf-8")
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(path.as_uri())
    assert page.locator(".still use").count() == 60
    assert page.locator(".frame.current").is_visible()
    assert "2 motions in 60 tracks" in page.inner_text("h1")
    assert page.locator("#track-table tbody tr").count() == 25
    assert page.locator("#player").is_hidden()
    context.close()


def test_a_big_sequence_is_small_enough_and_answers_at_once(open_page):
    report = many_tracks(tracks=5000, frames=30)
    assert len(render_page(report).encode()) <= 8_000_000
    opened = open_page(report)
    page = opened.page
    answer = """async (box) => {
        const input = document.querySelector(box);
        const start = performance.now();
        input.click();
        await new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
        return performance.now() - start; }"""
    page.wait_for_timeout(500)
    times = [page.evaluate(answer, "#labels input[data-label='1']") for _ in range(6)]
    assert np.median(times) <= 100
    start = time.perf_counter()
    page.fill("#slider", "17")
    assert time.perf_counter() - start < 2
    opened.clean()


@pytest.fixture
def label_server(tmp_path):
    report = affine_report()
    folder = str(tmp_path / "labels")
    with LabelServer(report.frames, report.pictures, folder) as server:
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        yield server
        server.shutdown()


def draw_polygon(page, corners, width):
    box = page.locator("#stage").bounding_box()
    ratio = box["width"] / width
    for x, y in corners:
        page.mouse.click(box["x"] + (x + 0.5) * ratio, box["y"] + (y + 0.5) * ratio)
    page.keyboard.press("Enter")


def test_two_polygons_drawn_by_hand_become_the_truth_of_a_report(browser, label_server):
    report = affine_report(truth=False)
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    complaints: list[str] = []
    page.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(label_server.url)
    page.wait_for_load_state("networkidle")
    draw_polygon(page, [(38, 58), (122, 58), (122, 122), (38, 122)], report.frames[0].width)
    page.select_option("#label", "2")
    page.focus("#stage")
    draw_polygon(page, [(198, 98), (282, 98), (282, 202), (198, 202)], report.frames[0].width)
    assert page.locator("#list li").count() == 2
    page.click("#save")
    page.wait_for_selector("#status:has-text('saved')")
    assert complaints == []
    page.close()
    mask = str(label_server.folder / "mask-1.png")
    truth = true_labels([mask], report.tracks, report.frames, 3.0)
    labels = report.labels
    assert (truth[labels == 1] == 1).all()
    assert (truth[labels == 2] == 2).all()


def test_a_polygon_can_be_drawn_with_the_keyboard_alone(browser, label_server):
    page = browser.new_page()
    page.goto(label_server.url)
    page.wait_for_selector("#stage:focus")
    for key in ["3", "Space", *["ArrowRight"] * 3, "Space", *["ArrowDown"] * 3, "Space", "Enter"]:
        page.keyboard.press(key)
    assert "motion 3, 3 vertices" in page.inner_text("#list")
    page.keyboard.press("s")
    page.wait_for_selector("#status:has-text('saved')")
    page.close()
    assert (label_server.folder / "mask-1.png").exists()


WIDER_THAN_THE_PAGE = """() => [...document.querySelectorAll('body *')]
    .filter((e) => e.getBoundingClientRect().right > innerWidth + 1 && !e.closest('.scroll, pre'))
    .map((e) => `${e.tagName}.${e.className}`)"""


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_a_phone_or_a_screen(open_page, width):
    opened = open_page(crowd(), viewport={"width": width, "height": 844})
    assert opened.page.evaluate(WIDER_THAN_THE_PAGE) == []
    heights = opened.page.eval_on_selector_all(
        "#labels .toggle, #provenance thead th",
        "all => all.map((e) => e.getBoundingClientRect().height)",
    )
    assert max(heights) < 45  # no word is broken, no name is in two lines
    opened.clean()


def test_print_cuts_nothing_and_lists_a_video_once(open_page):
    opened = open_page(crowd(), viewport={"width": 720, "height": 900})
    page = opened.page
    page.emulate_media(media="print")
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    cut = """() => [...document.querySelectorAll('.scroll, .toggles')]
        .filter((e) => e.scrollWidth > e.clientWidth + 1 || e.scrollHeight > e.clientHeight + 1)
        .map((e) => e.getAttribute('aria-label') ?? e.id)"""
    assert page.evaluate(cut) == []
    assert page.locator("#provenance tr:has-text('.mp4')").count() == 1
    assert "1–2" in page.inner_text("#provenance tr:has-text('.mp4')")


def test_ignored_tracks_have_a_word(open_page):
    opened = open_page(crowd())
    page = opened.page
    page.select_option("#filter", "-1")
    assert page.locator("#track-table tbody td:nth-child(3)").first.inner_text() == "ignored"
    opened.clean()


def test_a_row_is_selected_by_the_pointer_and_not_by_the_page_that_scrolls(pair):
    page = pair.page
    row = page.locator("#track-table tbody tr").nth(4)
    row.scroll_into_view_if_needed()
    row.hover()
    page.mouse.move(*[side + 2 for side in (row.bounding_box()["x"], row.bounding_box()["y"])])
    assert "selected" in row.get_attribute("class")
    pair.clean()


def test_the_label_page_says_what_zero_is(browser, label_server):
    page = browser.new_page()
    page.goto(label_server.url)
    page.wait_for_selector("#stage:focus")
    assert "0, the static world" in page.inner_text("header")
    assert "0 static world" in page.inner_text("#label")
    page.close()
