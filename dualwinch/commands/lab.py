"""``dualwinch lab``: the lab in a browser, and ``dualwinch show``: the same with a run of one's own."""

import webbrowser
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from dualwinch import __version__
from dualwinch.codegen.files import atomic
from dualwinch.commands.output import check_folder, terminal
from dualwinch.commands.progress import ProgressLine
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.lab.assemble import assemble
from dualwinch.lab.content import content
from dualwinch.lab.own_run import own_run
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.results.storage import load_result

HOST = "127.0.0.1"


def lab(out: Path | None, port: int, *, browser: bool) -> None:
    """Write the page, or serve it until an interrupt."""
    if not 0 <= port <= 65535:
        raise ConfigurationError(f"--port = {port}: must be 0 to 65535 (0: any that is free)")
    if out:
        _check(out)
    page = _page()
    if out:
        _write(page, out)
        return
    with server_of(page, port) as server:
        address = f"http://{HOST}:{server.server_port}/"
        terminal(stderr=True).print(f"the lab is at {address} (Ctrl-C ends it)")
        if browser:
            webbrowser.open(address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            terminal(stderr=True).print("ended")


def show(run: Path, out: Path | None, *, browser: bool) -> None:
    """Write the page with a run of one's own in it."""
    if not run.is_file():
        raise ConfigurationError(f"cannot read {run}: no such file")
    file = out or run.with_suffix(".html")
    _check(file)
    result = load_result(run)
    if not len(result.columns.get("t", ())):
        raise ConfigurationError(f"{run}: holds no rows to draw")
    page = _page(own_run(run.name, result))
    _write(page, file)
    if browser:
        webbrowser.open(file.absolute().as_uri())


def _page(own: dict[str, Any] | None = None) -> str:
    with ProgressLine("building the lab") as progress:
        made = content(load_ensemble("rig"), __version__, progress=progress)
    return assemble(made.catalogue, made.modules, own)


def _check(out: Path) -> None:
    if out.suffix.lower() not in {".html", ".htm"}:
        raise ConfigurationError(f"{out.name}: unknown suffix {out.suffix!r}; must be .html")
    check_folder(out.parent)


def _write(page: str, out: Path) -> None:
    with atomic(out) as unfinished:
        unfinished.write_text(page, encoding="utf-8")
    terminal(stderr=True, soft_wrap=True).print(f"wrote {out} ({len(page.encode()) / 1e6:.2f} MB)")


def server_of(page: str, port: int) -> ThreadingHTTPServer:
    """A server of one page on this machine alone.

    Raises:
        ConfigurationError: the port is taken.
    """
    text = page.encode()

    class Handler(BaseHTTPRequestHandler):
        """Gives the page, whatever is asked for at the root."""

        def do_GET(self) -> None:
            """Answer a request."""
            found = self.path.partition("?")[0] in {"/", "/index.html"}
            self.send_response(200 if found else 404)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(text) if found else 0))
            self.end_headers()
            if found:
                self.wfile.write(text)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002
            """Say nothing."""

    try:
        return ThreadingHTTPServer((HOST, port), Handler)
    except OSError as error:
        raise ConfigurationError(f"--port = {port}: {error.strerror}; 0 takes any that is free") from error
