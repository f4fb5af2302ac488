"""A Dask cluster on loopback for tests: a scheduler and workers, each a process of its own that can be killed."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest


@dataclass
class DaskProcesses:
    """Scheduler and workers.

    Attributes:
        folder: of what they write.
        address: of the scheduler.
        scheduler: its process.
        workers: processes of the workers, one thread each.
    """

    folder: Path
    address: str = ""
    scheduler: "subprocess.Popen[bytes] | None" = None
    workers: "list[subprocess.Popen[bytes]]" = field(default_factory=list)

    def start_scheduler(self, port: int = 0) -> None:
        """Start the scheduler, and wait for its address."""
        file = self.folder / "scheduler.json"
        file.unlink(missing_ok=True)
        words = ["--host", "127.0.0.1", "--port", str(port), "--no-dashboard", "--scheduler-file", str(file)]
        self.scheduler = self._start("scheduler", words)
        for _ in range(300):
            try:
                self.address = json.loads(file.read_text())["address"]
            except (OSError, ValueError):
                time.sleep(0.1)
            else:
                return
        raise AssertionError((self.folder / "scheduler.log").read_text())

    def start_worker(
        self, *words: str, nanny: bool = False, environment: Mapping[str, str] | None = None
    ) -> "subprocess.Popen[bytes]":
        """Start a worker of one thread; ``nanny``: with a process that watches its memory and starts it anew."""
        usual = ["--nthreads", "1", "--no-dashboard", "--nanny" if nanny else "--no-nanny"]
        name = f"worker-{len(self.workers)}"
        usual += ["--name", name, "--local-directory", str(self.folder / name)]
        self.workers.append(self._start("worker", [self.address, *usual, *words], name, environment))
        return self.workers[-1]

    def _start(
        self, kind: str, words: list[str], name: str = "", environment: Mapping[str, str] | None = None
    ) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", "dask", kind, *words]
        with (self.folder / f"{name or kind}.log").open("wb") as log:
            return subprocess.Popen(command, stdout=log, stderr=log, env={**os.environ, **(environment or {})})

    def stop(self) -> None:
        """End all that still run at once: a worker would finish its task first."""
        every = [*self.workers, *([self.scheduler] if self.scheduler else [])]
        for process in every:
            process.kill()  # what a nanny has started ends with it
        for process in every:
            process.wait()


@contextmanager
def dask_processes(folder: Path, workers: int = 2) -> Iterator[DaskProcesses]:
    """A scheduler and so many workers, gone at the end."""
    pytest.importorskip("distributed")
    processes = DaskProcesses(folder)
    try:
        processes.start_scheduler()
        for _ in range(workers):
            processes.start_worker()
        yield processes
    finally:
        processes.stop()
