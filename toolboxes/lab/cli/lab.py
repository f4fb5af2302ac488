"""The command ``lab``: the lab's page written or served; ``show`` and ``serve`` use its functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from dualwinch.toolbox import ProgressLine, options, output

if TYPE_CHECKING:
    from http.server import ThreadingHTTPServer

Browser = Annotated[bool, Parameter(help="Open the page in a browser.", negative="--no-browser")]


def lab(*, out: Path | None = None, port: Annotated[int, options.WHOLE] = 0, browser: Browser = True) -> None:
    """Play with the closed loop in a browser: every case, law and number, redrawn at once.

    The page is one file and needs no server; it runs what `simulate` runs, compiled to WebAssembly. The first
    call builds it, which takes about a minute and needs zig (`pip install ziglang`); it is kept for the next.

    Args:
        out: Write the page to this file (.html) instead of serving it.
        port: Port on this machine; 0: any that is free.

    Examples:
        dualwinch lab
        dualwinch lab --port 8000 --no-browser
        dualwinch lab --out lab.html
    """
    import webbrowser

    from dualwinch.toolbox import ConfigurationError

    if not 0 <= port <= 65535:
        raise ConfigurationError(f"--port = {port}: must be 0 to 65535 (0: any that is free)")
    output.check_file(out, *PAGES)
    page = page_of()
    if out:
        write_page(page, out)
        return
    with server_of(page, port) as server:
        address = f"http://{HOST}:{server.server_port}/"
        output.terminal(stderr=True).print(f"the lab is at {address} (Ctrl-C ends it)")
        if browser:
            webbrowser.open(address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            output.terminal(stderr=True).print("ended")


HOST = "127.0.0.1"

ADDRESS = "live"
"""Path of the requests for further rows of a live run, below the page's address."""

PAGES = (".html", ".htm")
"""Suffixes of pages."""


def page_of(own: dict[str, Any] | None = None) -> str:
    """Assemble the lab's page, with the user's own run if given."""
    from dualwinch.toolbox import ensemble_file
    from dualwinch.toolboxes.lab.assemble import assemble
    from dualwinch.toolboxes.lab.content import content

    with ProgressLine("building the lab", command="lab", patient=True) as progress:
        contents = content(ensemble_file.load_ensemble("rig"), version("dualwinch"), progress=progress)
    return assemble(contents.catalogue, contents.modules, own)


def write_page(page: str, out: Path) -> None:
    """Write the page, and print its size."""
    from dualwinch.toolbox import whole_files

    whole_files.write_whole(out, page)
    output.wrote(f"{out} ({len(page.encode()) / 1e6:.2f} MB)")


def server_of(page: str, port: int, live: Callable[[Mapping[str, int]], str] | None = None) -> ThreadingHTTPServer:
    """An HTTP server of one page at this machine's loopback address; port 0 is any that is free.

    A live run has further rows: (numbers in the query) → JSON (`lab.live.live_rows`).

    Raises:
        ConfigurationError: the port is taken.
    """
    from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
    from urllib.parse import parse_qsl, urlsplit

    from dualwinch.toolbox import ConfigurationError

    text = page.encode()

    class Handler(BaseHTTPRequestHandler):
        """Answer with the page at the root, and with further rows of a live run."""

        def do_GET(self) -> None:
            """Answer a request."""
            request = urlsplit(self.path)
            if live and request.path == f"/{ADDRESS}":
                numbers = {name: int(text[:15]) for name, text in parse_qsl(request.query) if text[:15].isdecimal()}
                self._give("application/json", live(numbers).encode())
            elif request.path in {"/", "/index.html"}:
                self._give("text/html; charset=utf-8", text)
            else:
                self._give("text/plain", b"", 404)

        def _give(self, kind: str, content: bytes, status: int = 200) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002
            """Say nothing."""

    try:
        return ThreadingHTTPServer((HOST, port), Handler)
    except OSError as error:
        raise ConfigurationError(f"--port = {port}: {error.strerror}; 0 takes any that is free") from error
