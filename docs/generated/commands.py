"""The reference of the command line, from the command line itself."""

import re


def _examples(epilogue: str | None) -> str:
    """The examples of a command, which stand behind its help."""
    _, _, text = (epilogue or "").partition("Examples:")
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return "\n".join(["", "**Examples**", "", "```sh", *lines, "```", ""]) if lines else ""


def commands_markdown() -> str:
    """A section a command with its options, defaults and examples; sub-commands stand within."""
    from dualwinch.cli.app import COMMANDS, app

    whole = app.generate_docs(output_format="markdown", recursive=True, heading_level=1)
    examples = {name: _examples(app[name].help_epilogue) for name in COMMANDS}
    text = []
    for section in re.split(r"^(?=## dualwinch )", whole, flags=re.MULTILINE)[1:]:
        name = section.split("\n", 1)[0].removeprefix("## dualwinch ")
        if name in examples:  # not what the library adds for shells
            text.append(section.rstrip() + "\n" + examples[name])
    return "\n".join(text).replace("```console\n", "```text\n")
