"""Commands that the system kills when so many tasks are finished and stored."""

import signal
import subprocess
import sys
from pathlib import Path

SCRIPT = """
import os, signal, sys
from dualwinch.simulation.batch.workers import CheckpointingExecutor
store = CheckpointingExecutor.store

def store_and_die(self, key, result):
    store(self, key, result)
    if len(list(self.folder.glob("*.result"))) == int(sys.argv[1]):
        os.kill(os.getpid(), signal.SIGKILL)

CheckpointingExecutor.store = store_and_die
from dualwinch.cli import main
main(sys.argv[2:])
"""


def killed_after(tasks: int, words: list[str], checkpoints: Path) -> dict[Path, int]:
    """Run a command until it has stored so many tasks; return their files and when each was written."""
    command = [sys.executable, "-c", SCRIPT, str(tasks), *words]
    ended = subprocess.run(command, check=False, capture_output=True)
    assert ended.returncode == -signal.SIGKILL, ended.stderr.decode()
    files = written(checkpoints)
    assert len(files) == tasks
    return files


def written(checkpoints: Path) -> dict[Path, int]:
    """Files of stored results, and when each was written."""
    return {file: file.stat().st_mtime_ns for file in checkpoints.glob("*.result")}
