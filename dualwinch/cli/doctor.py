"""Options of ``dualwinch doctor``."""

from cyclopts import App

app = App(name="doctor")


@app.default
def doctor() -> None:
    """Show which compiler, cache folder, processor features and optional parts are in use."""
    from dualwinch.commands.doctor import doctor as run

    run()
