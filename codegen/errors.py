"""The family of errors; every message is one line that says what was wrong and what would help."""


class DualwinchError(Exception):
    """Base of every error this project raises on purpose."""


class CodegenError(DualwinchError):
    """CasADi cannot generate C for a function."""


class CompilerNotFoundError(DualwinchError):
    """No C compiler on this machine."""


class CompileError(DualwinchError):
    """The C compiler failed."""


class CacheError(DualwinchError):
    """The folder of compiled libraries cannot be used."""


class CodegenWarning(UserWarning):
    """CasADi's own C stands where the emitter has none."""


class CacheWarning(UserWarning):
    """The folder of compiled libraries cannot be trusted, and another one is used."""


def installing(extra: str) -> str:
    """How an optional dependency is installed, as messages say it: by pip, or by uv, whose environments lack pip."""
    return f"pip install 'dualwinch[{extra}]', or uv run --extra {extra} ..."
