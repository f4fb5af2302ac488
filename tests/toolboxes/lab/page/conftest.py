"""The lab's page in a real Chromium; its tests skip where there is none."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from dualwinch.codegen.errors import CompilerNotFoundError
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.toolboxes.lab.content import Content
from tests.toolboxes.lab.in_node import of_id

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

FILTERED, HEAVY = "fando-nftsm+kalman", "fando-nftsm+site"

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.fixture(scope="session")
def made() -> Content:
    """Three structures of the paper's machine, one with a Kalman filter, and one of a heavy machine."""
    from dualwinch.toolboxes.lab.content import content
    from dualwinch.toolboxes.lab.wasm.structures import structures

    try:
        return content(load_ensemble("rig"), "test", offered=[*structures()[:3], of_id(FILTERED), of_id(HEAVY)])
    except CompilerNotFoundError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def lab_file(tmp_path_factory: pytest.TempPathFactory, made: Content) -> Path:
    """The page of these."""
    from dualwinch.toolboxes.lab.assemble import assemble

    file = tmp_path_factory.mktemp("lab") / "lab.html"
    file.write_text(assemble(made.catalogue, made.modules), encoding="utf-8")
    return file


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


class Lab:
    """A page that is open, with what it complained about."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.complaints: list[str] = []
        page.on("console", lambda message: self.complaints.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))

    @property
    def runs(self) -> int:
        """Runs shown so far."""
        return int(self.page.evaluate("document.documentElement.dataset.ready ?? 0"))

    def after(self, act: Callable[[], Any]) -> None:
        """Do something, and wait until the run that follows is shown and no other one is under way."""
        before = self.runs
        act()
        self.page.wait_for_function(f"Number(document.documentElement.dataset.ready ?? 0) > {before}")
        self.settle()

    def settle(self) -> None:
        """Wait until no run is under way."""
        self.page.wait_for_function("document.documentElement.dataset.busy === 'false'")

    def row(self, key: str) -> Any:
        """The row of a parameter, its section open."""
        row = self.page.locator(f'.row[data-key="{key}"]')
        row.evaluate("(row) => { row.closest('details').open = true; }")
        return row

    def write(self, key: str, text: str) -> None:
        """Write into the field of a parameter."""
        field = self.row(key).locator("input[type=text]")
        field.fill(text)
        field.press("Enter")

    def merit(self, name: str, column: int = 0) -> str:
        """A figure of merit as the table shows it."""
        row = self.page.locator("#merits tbody tr", has=self.page.locator("th", has_text=name)).first
        return row.locator("td").nth(column).inner_text()


@pytest.fixture
def opened(browser: Any, lab_file: Path) -> Iterator[Callable[..., Lab]]:
    """Opens the page; no test leaves an error in its console."""
    contexts, labs = [], []

    def opens(hash_text: str = "", *, width: int = 1200, height: int = 900, **options: Any) -> Lab:
        context = browser.new_context(viewport={"width": width, "height": height}, accept_downloads=True, **options)
        contexts.append(context)
        lab = Lab(context.new_page())
        labs.append(lab)
        lab.after(lambda: lab.page.goto(lab_file.as_uri() + hash_text))
        return lab

    yield opens
    complaints = [complaint for lab in labs for complaint in lab.complaints]
    for context in contexts:
        context.close()
    assert not complaints
