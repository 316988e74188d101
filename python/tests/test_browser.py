"""The page of a run and the studio in a browser: no errors, nothing cut, accessible, and all of it by keyboard."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT

sync_api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")

CHROMIUM = shutil.which("chromium")
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
PROGRAM = TARGET / "debug" / ("deltatwin.exe" if os.name == "nt" else "deltatwin")
QUIET = "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking --disable-component-update --disable-sync"
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
    pytest.mark.skipif(not PROGRAM.is_file(), reason=f"{PROGRAM} is not built (cargo build)"),
]
WIDTHS = {"wide": 1280, "narrow": 390}
SCHEMES = ("light", "dark")
# Longest wait for a stage on a busy machine, ms.
LONG = 120_000
sync_api.expect.set_options(timeout=LONG)

# Everything that the tabulator must reach, numbered.
CONTROLS = """() => [...document.querySelectorAll("a[href], button, select, input, summary, [tabindex='0']")]
    .filter(e => e.checkVisibility() && !e.disabled).map((e, k) => { e.dataset.test = k; return e.outerHTML.slice(0, 120); })"""
# The element that has the focus, and whether that is seen.
FOCUSED = """() => { const e = document.activeElement, s = getComputedStyle(e);
    return { k: e.dataset.test, html: e.outerHTML.slice(0, 120), seen: s.outlineStyle !== "none" && parseFloat(s.outlineWidth) >= 1 }; }"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        own = playwright.chromium.launch(executable_path=CHROMIUM, args=QUIET.split())
        yield own
        own.close()


def opened(browser: Any, url: str, **options: Any) -> tuple[Any, list[str]]:
    """A page, and what it writes to the console."""
    page = browser.new_context(**options).new_page()
    said: list[str] = []
    page.on("console", lambda message: said.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto(url)
    return page, said


def look(page: Any, what: str) -> None:
    """At every width and in both schemes of colours nothing is wider than the page, and axe finds no violation."""
    for width in WIDTHS.values():
        for scheme in SCHEMES:
            page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
            page.set_viewport_size({"width": width, "height": 900})
            where = f"{what}, {width} px, {scheme}"
            # Charts follow the width of the page after a moment.
            for _ in range(20):
                if (wide := page.evaluate("document.documentElement.scrollWidth")) <= width:
                    break
                page.wait_for_timeout(100)
            assert wide <= width, where
            found = axe.Axe().run(page)
            assert found.violations_count == 0, f"{where}: {found.generate_report()}"
    page.set_viewport_size({"width": WIDTHS["wide"], "height": 900})


def tabbed(page: Any) -> None:
    """The tabulator reaches every control, and every one shows that it has the focus."""
    controls = page.evaluate(CONTROLS)
    assert controls
    missing = dict(enumerate(controls))
    page.evaluate("document.activeElement.blur()")
    for _ in range(len(controls) + 3):
        page.keyboard.press("Tab")
        focused = page.evaluate(FOCUSED)
        if focused["k"] is not None:
            missing.pop(int(focused["k"]), None)
            assert focused["seen"], focused["html"]
    assert not missing, missing


def press(page: Any, part: str, name: str) -> None:
    """Tabs to the button of this name in a part of the page and presses Enter."""
    button = page.locator(part).get_by_role("button", name=name, exact=True).first
    sync_api.expect(button).to_be_enabled()
    for _ in range(300):
        if button.evaluate("e => e === document.activeElement"):
            page.keyboard.press("Enter")
            return
        page.keyboard.press("Tab")
    raise AssertionError(f"the tabulator does not reach `{name}`")


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pages")
    run(folder, "example", "-o", "example")
    run(folder, "run", "irb360-6-1600", "example/first.csv", "--held-out", "example/second.csv", "-o", "run")
    return folder


def run(folder: Path, *arguments: str) -> None:
    done = subprocess.run([PROGRAM, *arguments], cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def report(browser: Any, example: Path) -> Iterator[Any]:
    """The page of a run; its security policy does not hold for what the tests ask."""
    page, said = opened(browser, (example / "run" / "report.html").as_uri(), bypass_csp=True)
    page.locator("html[data-ready]").wait_for()
    yield page
    assert not said
    page.context.close()


def test_the_page_of_a_run_is_accessible_and_fits_every_screen(report: Any) -> None:
    look(report, "run")
    report.locator("details").evaluate_all("all => all.forEach(e => { e.open = true; })")
    report.get_by_role("button", name="measured and model").click()
    look(report, "run, all opened")


def test_no_estimate_is_cut(report: Any) -> None:
    for width in WIDTHS.values():
        report.set_viewport_size({"width": width, "height": 900})
        cells = report.locator("table.parameters tbody td")
        assert cells.count() > 20
        for cell in cells.all():
            box = cell.bounding_box()
            assert box["x"] >= 0 and box["x"] + box["width"] <= width, f"{width} px: {cell.inner_text()}"
        table = report.locator(".wide:has(table.parameters)")
        assert table.evaluate("e => e.scrollWidth <= e.clientWidth"), width


def test_the_page_of_a_run_is_used_by_keyboard(report: Any) -> None:
    tabbed(report)
    toggle = report.get_by_role("button", name="measured and model")
    plots = report.locator(".plot").count()
    press(report, "main", "measured and model")
    sync_api.expect(toggle).to_have_attribute("aria-pressed", "true")
    assert report.locator(".plot").count() > plots


def test_any_signal_is_drawn_over_any_other_by_keyboard(report: Any) -> None:
    pair = report.locator(".plot.pair")
    names = [report.get_by_label(f"signal on {axis}") for axis in "yx"]
    assert names[0].locator("option").count() == names[1].locator("option").count() > 12
    pictures = set()
    # A residual over a rate at first; the letter `a` goes from one signal of an axis to the next.
    for keys, label in [("", "residual of "), ("a", "axis 1 angle over "), ("a", "axis 2 angle over ")]:
        names[0].focus()
        report.keyboard.type(keys)
        sync_api.expect(pair).to_have_attribute("aria-label", re.compile(f"^{label}"))
        pictures.add(pair.locator("canvas").evaluate("e => e.toDataURL()"))
    assert len(pictures) == 3
    # A signal over itself is a straight line.
    names[1].select_option(label="axis 2 angle")
    sync_api.expect(pair).to_contain_text("r 1")
    for width in WIDTHS.values():
        report.set_viewport_size({"width": width, "height": 900})
        sync_api.expect(pair.locator(".u-wrap")).to_be_visible()
        assert all(n.bounding_box()["x"] + n.bounding_box()["width"] <= width for n in names), width


def test_the_chosen_time_says_what_is_in_it(report: Any) -> None:
    report.get_by_role("button", name="what is here?").press("Enter")
    here = report.get_by_role("region", name="what is in the chosen time")
    table = here.locator("table").first

    def shares() -> list[float]:
        return [float(text.split(",")[-1].strip(" \u00a0%")) for text in table.locator("td").all_inner_texts()]

    # All of the error lies in the whole recording; parts next to each other have all of it together.
    assert set(shares()) == {100.0}
    parts = []
    t0, t1 = report.evaluate("deltatwin.living()[0].whole")
    for a, b in [(t0, t0 + 0.3 * (t1 - t0)), (t0 + 0.3 * (t1 - t0), t1)]:
        report.evaluate("([a, b]) => deltatwin.living()[0].show(a, b)", [a, b])
        expected = report.evaluate("ends => ends.map(deltatwin.digits).join(' to ')", [a, b])
        sync_api.expect(here.locator("p").first).to_contain_text(expected)
        parts.append(shares())
    assert all(abs(p + q - 100.0) < 1.0 for p, q in zip(*parts, strict=True)), parts
    assert any(abs(p - 30.0) > 3.0 for p in parts[0]), parts
    # Every stage shown has a column.
    columns = table.locator("thead th").count()
    press(report, "main", "identified")
    sync_api.expect(table.locator("thead th")).to_have_count(columns - 1)
    look(report, "what is here?")


def test_the_chosen_time_says_which_effect_explains_it(report: Any, example: Path) -> None:
    result = json.loads((example / "run" / "result.json").read_text())
    found = [effect["name"] for effect in result["stages"]["diagnose"]["effects"]]
    report.get_by_role("button", name="what is here?").press("Enter")
    rows = report.locator("table.explained tbody tr")

    def explained() -> dict[str, float]:
        """Share over all channels by row, %."""
        cells = [(row.locator("th").inner_text(), row.locator("td").first.inner_text()) for row in rows.all()]
        return {name: float(text.replace("−", "-").strip(" \u00a0%")) for name, text in cells}

    whole = explained()
    candidates = {name: share for name, share in whole.items() if name in {c["name"] for c in result["stages"]["diagnose"]["candidates"]}}
    assert 2 <= len(candidates) <= 8
    # Over the whole recording the effect found is the best explanation, and with the noise it is all of the residual.
    assert max(candidates, key=candidates.__getitem__) in found
    refitted = next(share for name, share in whole.items() if name.endswith("all refitted"))
    assert abs(refitted + whole["noise"] - 100.0) < 5.0, whole
    # In parts of the recording the shares differ, and their mean weighted by the squares is the whole.
    first, width, bins = report.evaluate("(e => [e.first, e.width, e.samples.length])(deltatwin.living()[0].header.explained)")
    parts = []
    for a, b in [(0, bins // 4), (bins // 4, bins)]:
        report.evaluate("([a, b]) => deltatwin.living()[0].show(a, b)", [first + a * width, first + b * width])
        expected = report.evaluate("ends => ends.map(deltatwin.digits).join(' to ')", [first + a * width, first + b * width])
        sync_api.expect(report.locator(".here h3")).to_contain_text(expected)
        weight = report.evaluate(
            "([a, b]) => deltatwin.living()[0].header.explained.before.flatMap(c => c.slice(a, b)).reduce((x, y) => x + y)", [a, b]
        )
        parts.append((weight, explained()))
    total = sum(weight for weight, _ in parts)
    for name, share in whole.items():
        mean = sum(weight * part[name] for weight, part in parts) / total
        assert abs(mean - share) < 0.2, (name, mean, share)
    assert any(abs(parts[0][1][name] - parts[1][1][name]) > 1.0 for name in candidates)


def test_the_robot_follows_the_cursor_and_is_turned_by_keys(report: Any) -> None:
    robot = report.get_by_role("group", name="the robot", exact=True)
    canvas = robot.locator("canvas")
    sync_api.expect(canvas).to_have_attribute("aria-label", re.compile("axis 1 torque [0-9.]+.*arrow keys"))

    def picture() -> str:
        report.wait_for_timeout(100)
        return canvas.evaluate("e => e.toDataURL()")

    views = [picture()]
    for key in ["ArrowLeft", "ArrowUp"]:
        canvas.press(key)
        views.append(picture())
    assert len(set(views)) == 3
    canvas.press("ArrowRight")
    canvas.press("ArrowDown")
    assert picture() == views[0]
    # Of the delivered model, whose error is larger at some moments than at others, the limbs change their colour.
    for stage in ["effect added", "identified"]:
        report.get_by_role("button", name=stage, exact=True).first.click()
    chart = report.locator(".moving .u-over").first
    used, times = set(), set()
    for share in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8):
        box = chart.bounding_box()
        chart.hover(position={"x": share * box["width"], "y": 20})
        report.wait_for_timeout(60)
        times.add(canvas.get_attribute("aria-label").split(",")[0])
        used.add(tuple(report.evaluate("[...deltatwin.living()[0].robot.ratios().keys()].map(k => deltatwin.living()[0].robot.grade(k))")))
    assert len(times) == 8 and len(used) > 1, (times, used)
    # Played, it moves by itself and marks the moment in the charts.
    press(report, ".robot", "play")
    first = picture()
    report.wait_for_timeout(400)
    assert picture() != first
    sync_api.expect(report.locator(".moment").first).to_be_visible()
    press(report, ".robot", "pause")
    still = picture()
    report.wait_for_timeout(200)
    assert picture() == still


def test_the_page_of_a_run_obeys_its_own_policy(browser: Any, example: Path) -> None:
    page, said = opened(browser, (example / "run" / "report.html").as_uri())
    page.locator("html[data-ready]").wait_for()
    assert page.locator(".signals-panels canvas").count() > 5
    assert not said
    page.context.close()


# What shows that the panel of a stage is there.
PARTS = {
    "Data": "table.map",
    "Check": "table.checks",
    "Fit": "table.parameters",
    "Where": ".signals-panels canvas",
    "Why": ".candidate button",
    "Add": "table.parameters",
    "Next": "p",
    "Save": ".command",
}


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[str]:
    """Address of a studio on an empty folder."""
    if subprocess.run([PROGRAM, "studio", "--help"], capture_output=True, check=False).returncode != 0:
        pytest.skip(f"{PROGRAM} is built without the studio (cargo build -p deltatwin-cli --features studio)")
    server = subprocess.Popen([PROGRAM, "studio", "session", "--json"], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    try:
        yield json.loads(server.stdout.readline())["url"]
    finally:
        server.kill()
        server.wait()


def test_the_loop_in_the_studio_by_keyboard_and_every_stage_on_every_screen(browser: Any, studio: str) -> None:
    page, said = opened(browser, studio, bypass_csp=True)
    current = page.locator("#steps [aria-current=step]")
    look(page, "empty studio")
    tabbed(page)
    press(page, "main", "Try an example")
    stages = [("Data", "Check"), ("Check", "Fit"), ("Fit", "Where does it fail?"), ("Where", "Why?")]
    for stage, then in stages:
        sync_api.expect(current).to_have_text(stage)
        if stage == "Check":
            # The payload of the example is stated by its setups.
            sync_api.expect(page.locator("#panel")).to_contain_text("The recordings belong to the model")
        press(page, "main", then)
    found = page.locator(".candidate.found button").first
    found.wait_for(timeout=LONG)
    sync_api.expect(page.locator("#job")).to_be_hidden()
    added = found.inner_text()
    tabbed(page)
    press(page, "main", added)
    sync_api.expect(current).to_have_text("Add")
    sync_api.expect(page.locator("#versions li.current")).to_contain_text("+ ")
    for stage, part in PARTS.items():
        page.locator("#steps").get_by_role("button", name=stage).click()
        sync_api.expect(current).to_have_text(stage)
        sync_api.expect(page.locator("#job")).to_be_hidden()
        page.locator("#panel").locator(part).first.wait_for(timeout=LONG)
        look(page, stage)
        tabbed(page)
    press(page, "main", "Save the page")
    sync_api.expect(page.get_by_role("link", name="report.html")).to_be_visible()
    press(page, "aside", "undo")
    sync_api.expect(page.locator("#versions li.current")).not_to_contain_text("+ ")
    assert not said
    page.context.close()


def test_a_remedy_belongs_to_its_recording_and_is_undone(
    browser: Any, studio: str, example: Path, tmp_path: Path
) -> None:
    rows = [line.split(",") for line in (example / "example" / "first.csv").read_text().splitlines()]
    turned = rows[0].index("tau1")
    for row in rows[1:]:
        row[turned] = str(-float(row[turned]))
    (tmp_path / "turned.csv").write_text("\n".join(",".join(row) for row in rows) + "\n")
    shutil.copy(example / "example" / "first.setup.toml", tmp_path / "turned.setup.toml")
    files = [tmp_path / "turned.setup.toml", tmp_path / "turned.csv"]
    files += [example / "example" / name for name in ("second.setup.toml", "second.csv")]
    page, said = opened(browser, studio, bypass_csp=True)
    page.get_by_label("files", exact=True).set_input_files(files)
    rows_of = page.locator("#panel .row")
    sync_api.expect(rows_of.filter(has_text="second.csv")).to_be_visible()
    page.get_by_label("model that comes with the program").select_option("irb360-6-1600")
    press(page, "main", "Check")
    remedy = page.locator(".remedy").filter(has_text="tau1=-tau1").get_by_role("button", name="apply and check again").first
    remedy.press("Enter")
    sync_api.expect(page.locator("#panel")).to_contain_text("The recordings belong to the model")
    own = [tmp_path / "session" / "data" / f"{name}.setup.toml" for name in ("turned", "second")]
    assert "maps = [\"tau1=-tau1\"]" in own[0].read_text() and "maps" not in own[1].read_text()
    page.locator("#steps").get_by_role("button", name="Data").click()
    sync_api.expect(page.locator("#panel code").filter(has_text="tau1=-tau1")).to_have_count(1)
    look(page, "a map of a recording")
    without = page.get_by_role("button", name="read data/turned.csv without tau1=-tau1", exact=True)
    without.press("Enter")
    sync_api.expect(without).to_have_count(0)
    assert own[0].read_text() == files[0].read_text()
    assert not said
    page.context.close()


def test_a_machine_is_watched_until_its_stream_ends(
    browser: Any, studio: str, example: Path, tmp_path: Path
) -> None:
    if subprocess.run([PROGRAM, "watch", "--help"], capture_output=True, check=False).returncode != 0:
        pytest.skip(f"{PROGRAM} is built without the watch (cargo build -p deltatwin-cli --features full)")
    page, said = opened(browser, studio, bypass_csp=True)
    page.get_by_label("files", exact=True).set_input_files([example / "run" / "model.toml"])
    sync_api.expect(page.locator("#panel .row").filter(has_text="model.toml")).to_be_visible()
    page.locator("#steps").get_by_role("button", name="Watch").click()
    sync_api.expect(page.locator("#panel").get_by_role("button", name="Watch", exact=True)).to_be_disabled()
    look(page, "watch, before")
    sync_api.expect(page.locator("#message")).to_be_hidden()
    # A file that grows while the page looks: sixteen seconds of the machine as it is, then with another drive.
    lines = (example / "example" / "second.csv").read_text().splitlines(keepends=True)
    growing, half = tmp_path / "growing.csv", 4 * len(lines) // 5
    growing.write_text("".join(lines[:half]))
    shutil.copy(example / "example" / "second.setup.toml", tmp_path / "growing.setup.toml")
    page.get_by_label("file that grows").fill(str(growing))
    page.get_by_label("healthy seconds").fill("8")
    page.get_by_label("ends after seconds").fill("8")
    press(page, "#panel", "Watch")
    verdict = page.locator(".watch [role=status]")
    sync_api.expect(verdict).to_contain_text("The machine is as it was")
    assert page.locator(".watch .plot").count() >= 2 and page.locator(".watch .plot .keys").count() == page.locator(".watch .plot").count()
    torque = lines[0].strip().split(",").index("tau1")
    with growing.open("a") as file:
        for line in lines[half:]:
            cells = line.strip().split(",")
            cells[torque] = str(float(cells[torque]) + 1.5)
            file.write(",".join(cells) + "\n")
    sync_api.expect(verdict).to_contain_text("The machine has changed since about")
    sync_api.expect(verdict).to_contain_text("The stream has ended")
    sync_api.expect(page.locator("#panel").get_by_role("button", name="End the watch")).to_be_disabled()
    sync_api.expect(page.locator("#panel .command code")).to_contain_text("deltatwin watch models/model.toml")
    look(page, "watch, at the end")
    tabbed(page)
    # A watch that cannot begin says why.
    page.get_by_label("file that grows").fill(str(tmp_path / "nothing.csv"))
    press(page, "#panel", "Watch")
    sync_api.expect(verdict).to_contain_text("nothing.csv")
    assert not said
    page.context.close()
