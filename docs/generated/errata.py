"""The paper's errata and the assumptions about what it leaves open: the content of docs/errata.md."""

from dualwinch.toolboxes.paper.errata import INTRODUCTION, NOTES


def errata_markdown() -> str:
    """The table as Markdown: the whole content of docs/errata.md."""
    sources = (
        "The report of `dualwinch reproduce` has keys and source files of each, [the paper](paper.md) their effects."
    )
    lines = ["# Errata and assumptions", "", INTRODUCTION, sources, ""]
    for kind, heading in (("erratum", "Errata"), ("assumption", "Assumptions")):
        paper = "the paper prints" if kind == "erratum" else "the paper leaves open"
        lines += [
            f"## {heading}",
            "",
            f"| | about | {paper} | dualwinch does |",
            "|---|---|---|---|",
        ]
        for note in NOTES:
            if note.kind == kind:
                cells = (
                    note.id,
                    note.subject,
                    note.paper,
                    " ".join(filter(None, (note.here, note.effect, f"([more]({note.page}))" if note.page else ""))),
                )
                lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        lines.append("")
    return "\n".join(lines).rstrip("\n") + "\n"
