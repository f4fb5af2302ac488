"""Execute the notebooks and keep their outputs: ``python -m docs.notebooks [FILE...]`` (all: a few minutes)."""

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "notebooks"


def execute(path: Path) -> None:
    """One notebook, from top to bottom; what says when and by which Python is left out."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(ROOT)}}).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    notebook.metadata["language_info"] = {"name": "python"}
    nbformat.write(notebook, path)


def main() -> None:
    """All notebooks, or those whose paths are given."""
    for path in map(Path, sys.argv[1:] or sorted(FOLDER.glob("*.ipynb"))):
        sys.stdout.write(f"{path}\n")
        execute(path)


if __name__ == "__main__":
    main()
